"""A headless browser with WebGL2: it opens a page that the test serves, and the page posts what it found."""

import base64
import contextlib
import itertools
import json
import os
import queue
import shutil
import signal
import subprocess
import tempfile
import threading
import time
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


@contextlib.contextmanager
def _running(url: str, log, *flags: str, fds: tuple[int, ...] = ()) -> Iterator[None]:
    """The browser with a profile of its own, until the end of the block."""
    with tempfile.TemporaryDirectory(prefix="gsgi-browser-", ignore_cleanup_errors=True) as profile:
        command = [find_browser(), *WEBGL, "--no-sandbox", "--no-first-run", f"--user-data-dir={profile}", *flags, url]
        if fds:  # a pipe for the DevTools protocol is 3 and 4
            command = ["bash", "-c", f'exec "$@" 3<&{fds[0]} 4>&{fds[1]}', "bash", *command]
        process = subprocess.Popen(command, stdout=log, stderr=log, start_new_session=True, pass_fds=fds)
        try:
            yield
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def visit(path: str, folders: Mapping[str, Path], *flags: str) -> dict:
    """Open /NAME/FILE of `folders`, and return the JSON that the page posts to /result.

    Its key "console" is what the browser wrote to the console meanwhile, a list of lines, but for the driver's remarks
    that reading a picture back takes time. Fails if nothing comes.
    """
    results, posted = queue.Queue(), None
    with (
        tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace") as log,
        _serving(folders, results) as address,
    ):
        with _running(f"{address}/{path}", log, "--enable-logging=stderr", *flags), contextlib.suppress(queue.Empty):
            posted = results.get(timeout=PATIENCE)
        log.seek(0)
        lines = log.read().splitlines()
    assert posted is not None, f"{path} posted nothing:\n" + "\n".join(lines)
    console = [line for line in lines if ":CONSOLE" in line and "GPU stall due to ReadPixels" not in line]
    return json.loads(posted) | {"console": console}


def screenshot(path: str, folders: Mapping[str, Path], size: tuple[int, int], ready: str) -> bytes:
    """A PNG file of /NAME/FILE of `folders`, `size` px large, once the expression `ready` is true in the page."""
    orders, answers = os.pipe(), os.pipe()
    numbers = itertools.count(1)

    def ask(method: str, session: str | None = None, **parameters):
        number = next(numbers)
        order = {"id": number, "method": method, "params": parameters} | ({"sessionId": session} if session else {})
        os.write(orders[1], json.dumps(order).encode() + b"\0")
        while True:  # events come in between
            message = b"".join(iter(lambda: os.read(answers[0], 1), b"\0"))
            if (answer := json.loads(message)).get("id") == number:
                assert "result" in answer, f"{method}: {answer['error']}"
                return answer["result"]

    width, height = size
    flags = "--remote-debugging-pipe", "--hide-scrollbars"
    fds = orders[0], answers[1]
    with _serving(folders, queue.Queue()) as address, _running("about:blank", subprocess.DEVNULL, *flags, fds=fds):
        page = ask("Target.createTarget", url="about:blank")["targetId"]
        session = ask("Target.attachToTarget", targetId=page, flatten=True)["sessionId"]
        screen = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        ask("Emulation.setDeviceMetricsOverride", session, **screen)
        ask("Page.navigate", session, url=f"{address}/{path}")
        asked = {"expression": f"Boolean({ready})"}  # fails, without a value, while there is no document yet
        while not ask("Runtime.evaluate", session, **asked)["result"].get("value"):
            time.sleep(0.1)
        data = ask("Page.captureScreenshot", session, format="png")["data"]
    for end in (*orders, *answers):
        os.close(end)
    return base64.b64decode(data)
