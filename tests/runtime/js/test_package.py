"""The npm package: its size, its types, its files, and what the documentation says of it."""

import json
import re
import shutil
import subprocess
import tarfile
import tomllib
from pathlib import Path

import numpy as np
import pytest
from browser import visit
from gsgi_files import constant
from javascript import JS, node
from repository import ROOT, TESTS

from gsgi.runtime.file import codec

PACKAGE = json.loads((JS / "package.json").read_text())
PAGE_MAX, ALL_MAX = 10_000, 20_480  # bytes, of what a page loads at once, and with what its worker loads besides


def tool(name: str):
    """A program of the development dependencies. Skips where they are not installed."""
    path = JS / "node_modules" / ".bin" / name
    if not path.exists():
        pytest.skip(f"{name} is not installed: npm ci in runtime/js")
    return path


def documented() -> tuple[str, str]:
    """The two pieces of JavaScript in the section on three.js: the import, and the rest."""
    section = (ROOT / "docs" / "integrate.md").read_text(encoding="utf-8").partition("\n## In three.js\n")[2]
    code = re.search(r"```js\n(.*?)```", section, re.DOTALL)[1]
    statement, _, rest = code.partition("\n\n")
    return statement, rest


def test_our_part_is_small(tmp_path):
    options = "--bundle", "--splitting", "--minify", "--format=esm", "--external:three", f"--outdir={tmp_path}"
    options += (f"--metafile={tmp_path / 'meta.json'}",)
    subprocess.run([tool("esbuild"), JS / "three.js", JS / "worker.js", *options], capture_output=True, check=True)
    outputs = json.loads((tmp_path / "meta.json").read_text())["outputs"].items()
    outputs = {Path(path).name: output for path, output in outputs}

    def loaded(entry: str) -> set[str]:
        imports = [each for each in outputs[entry]["imports"] if each["kind"] == "import-statement"]
        return {entry} | {Path(each["path"]).name for each in imports} & set(outputs)

    page, worker = loaded("three.js"), loaded("worker.js")
    sizes = {name: output["bytes"] for name, output in outputs.items()}
    parts = {name: sum(map(sizes.get, part)) for name, part in {"page": page, "worker": worker - page}.items()}
    print(f"{parts} bytes, {sum(sizes.values())} in all")
    assert parts["page"] < PAGE_MAX
    assert sum(sizes.values()) < ALL_MAX


def test_the_types_fit_what_the_documentation_does(tmp_path):
    (tmp_path / "node_modules").symlink_to(JS / "node_modules")
    (tmp_path / "gsgi").symlink_to(JS)
    statement, rest = documented()
    source = f'import {{ Scene }} from "three";\n{statement.replace("gsgi/three", "./gsgi/three.js")}\n'
    source += 'import { decode, lookupSource, lookupTables, shCounts, type Bake } from "./gsgi/index.js";\n'
    source += f"const scene = new Scene();\n{rest}\nexport {{}};\n"
    source += "const bake: Bake = decode(new ArrayBuffer(0));\n"
    source += 'if (bake.operator === "surface") lookupSource(shCounts(bake)) + lookupTables(bake).cells[0];\n'
    (tmp_path / "sample.ts").write_text(source)
    options = "--noEmit", "--strict", "--skipLibCheck", "--target", "esnext", "--module", "nodenext"
    (tmp_path / "package.json").write_text('{"type": "module"}')
    run = subprocess.run([tool("tsc"), *options, "sample.ts"], cwd=tmp_path, capture_output=True, text=True)
    assert run.returncode == 0, run.stdout + run.stderr


def test_the_package_holds_what_it_exports():
    for entry in PACKAGE["exports"].values():
        assert all((JS / path).is_file() for path in entry.values())
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert PACKAGE["version"] == project["version"]
    assert PACKAGE["license"] in project["license"]
    names = node("--input-type=module", "--eval", f'console.log(Object.keys(await import("{JS}/index.js")).join(" "))')
    types = re.findall(r"export (?:class|function) (\w+)", (JS / "index.d.ts").read_text())
    assert sorted(types) == names.split()


def test_a_packed_package_has_the_licence(tmp_path):
    if not (npm := shutil.which("npm")):
        pytest.skip("npm is not installed")
    copy = tmp_path / "js"
    shutil.copytree(JS, copy, ignore=shutil.ignore_patterns("node_modules", "page"))
    subprocess.run([npm, "pack", "--offline"], cwd=copy, capture_output=True, check=True)
    with tarfile.open(copy / f"gsgi-{PACKAGE['version']}.tgz") as packed:
        names = {Path(name).name for name in packed.getnames()}
        licence = packed.extractfile("package/LICENSE").read()
    assert licence == (ROOT / "LICENSE").read_bytes()
    assert {"index.js", "three.js", "worker.js", "index.d.ts", "three.d.ts"} < names


def test_the_lock_file_names_no_host():
    lock = json.loads((JS / "package-lock.json").read_text())
    assert all("resolved" not in package and package.get("link") is None for package in lock["packages"].values())


def test_the_code_of_the_documentation_lights_a_scene(tmp_path):
    statement, rest = documented()
    (tmp_path / "room.gsgi").write_bytes(codec.encode(constant([0.5, 0.25, 0.125])))
    imports = json.dumps({"imports": {"three": "/js/page/three.js", "gsgi/three": "/js/three.js"}})
    (tmp_path / "index.html").write_text(
        '<!doctype html><link rel="icon" href="data:,">'
        f'<script type="importmap">{imports}</script><script type="module" src="host.js"></script>'
    )
    (tmp_path / "host.js").write_text(f"""
        import * as THREE from "three";
        import {{ post }} from "/pages/post.js";
        {statement}
        const scene = new THREE.Scene(), camera = new THREE.PerspectiveCamera();
        scene.add(new THREE.Mesh(new THREE.PlaneGeometry(), new THREE.MeshLambertMaterial()));
        camera.position.z = 1;
        await post(async () => {{
            {rest}
            const renderer = new THREE.WebGLRenderer(), pixel = new Float32Array(4);
            const target = new THREE.WebGLRenderTarget(1, 1, {{ type: THREE.FloatType }});
            renderer.setRenderTarget(target);
            renderer.render(scene, camera);
            renderer.readRenderTargetPixels(target, 0, 0, 1, 1, pixel);
            return {{ pixel: [...pixel.slice(0, 3)] }};
        }});
    """)
    pages = TESTS / "runtime" / "js" / "pages"
    found = visit("host/index.html", {"host": tmp_path, "js": JS, "pages": pages})
    np.testing.assert_allclose(found.get("pixel", found), [0.25, 0.125, 0.0625], rtol=2e-3)
    assert found["console"] == []
