"""Milliseconds in which each reader decodes a large file."""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

from benches.splats import ROUNDS, fastest, grid, on_surfaces

COUNT = 100_000  # fine Gaussians, whose light is linear in their plane
SCRIPT = """
import { readFileSync } from "node:fs";
const { decode } = await import(`${process.env.JS}/index.js`), data = readFileSync(process.argv[1]);
for (let i = 0; i < process.env.ROUNDS; ++i) {
    const start = performance.now();
    decode(data);
    console.log(performance.now() - start);
}
"""


def decoders() -> list[dict]:
    """A file of 100 thousand Gaussians, decoded in Python, C and Node.js: fastest of 12, and the first in Node.js."""
    from c_library import Library, build
    from javascript import JS, node

    from gsgi.runtime.file import codec
    from gsgi.runtime.gaussians import Bake, SurfaceBlend

    fine, rng = on_surfaces(COUNT), np.random.default_rng(0)
    fine = replace(fine, slope=rng.normal(0, 0.1, (COUNT, 2)).astype(np.float32))
    data = codec.encode(Bake(fine, SurfaceBlend(), coarse=grid()))
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        library = Library(build(folder, "-DBUILD_SHARED_LIBS=ON", "-DCMAKE_BUILD_TYPE=Release") / "libgsgi.so")
        seconds = fastest({
            ("python",): lambda: codec.decode(data),
            ("c",): lambda: library.close(library.opened(data)),
        })  # fmt: skip
        file = folder / "many.gsgi"
        file.write_bytes(data)
        first, *others = map(float, node("--input-type=module", "--eval", SCRIPT, file, JS=JS, ROUNDS=ROUNDS).split())
    found = {"python": 1e3 * seconds["python",], "c": 1e3 * seconds["c",], "js": min(others), "js_first": first}
    return [{"gaussians": COUNT, "bytes": len(data)} | {f"{name}_ms": round(ms, 1) for name, ms in found.items()}]
