"""A headless browser with WebGL2: it opens a page that the test serves, and the page posts what it found."""

import contextlib
import json
import os
import queue
import shutil
import signal
import subprocess
import tempfile
import threading
from collections.abc import Iterator, Mapping
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

NAMES = "chromium-headless-shell", "chromium", "chromium-browser", "google-chrome"
WEBGL = "--headless=new", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--mute-audio"
PATIENCE = 120  # s; how long a page may take on a busy machine


def find_browser() -> str:
    """Path of a Chromium. Skips where there is none."""
    found = next((path for path in map(shutil.which, NAMES) if path), None)
    if found is None:
        pytest.skip(f"none of {', '.join(NAMES)} is installed")
    return found


class _Handler(SimpleHTTPRequestHandler):
    """Serves /NAME/... from the folder of that name, and takes what is posted."""

    def __init__(self, *arguments, folders: Mapping[str, Path], results: queue.Queue, **options):
        self._folders, self._results = folders, results
        super().__init__(*arguments, **options)

    def translate_path(self, path: str) -> str:
        name, _, rest = path.partition("?")[0].partition("#")[0].lstrip("/").partition("/")
        folder = self._folders.get(name)
        return str(folder / rest) if folder else os.devnull + "/"

    def do_POST(self):
        self._results.put(self.rfile.read(int(self.headers["Content-Length"])))
        self.send_response(204)
        self.end_headers()

    def log_message(self, *arguments):
        pass


@contextlib.contextmanager
def _serving(folders: Mapping[str, Path], results: queue.Queue) -> Iterator[str]:
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(_Handler, folders=folders, results=results))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


def visit(path: str, folders: Mapping[str, Path], *flags: str) -> dict:
    """Open /NAME/FILE of `folders`, and return the JSON that the page posts to /result.

    Its key "console" is what the browser wrote to the console meanwhile, a list of lines, but for the driver's remarks
    that reading a picture back takes time. Fails if nothing comes.
    """
    browser, results = find_browser(), queue.Queue()
    with (
        tempfile.TemporaryDirectory(prefix="gsgi-browser-", ignore_cleanup_errors=True) as profile,
        tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as log,
        _serving(folders, results) as address,
    ):
        command = [browser, *WEBGL, "--no-sandbox", "--no-first-run", "--enable-logging=stderr", *flags]
        command += [f"--user-data-dir={profile}", f"{address}/{path}"]
        process = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True)
        try:
            posted = results.get(timeout=PATIENCE)
        except queue.Empty:
            posted = None
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()
        log.seek(0)
        lines = log.read().splitlines()
    assert posted is not None, f"{path} posted nothing:\n" + "\n".join(lines)
    console = [line for line in lines if ":CONSOLE" in line and "GPU stall due to ReadPixels" not in line]
    return json.loads(posted) | {"console": console}
