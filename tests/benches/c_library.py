"""The C library beside the Python runtime: milliseconds of the same work in one run."""

import tempfile
from pathlib import Path

import numpy as np
import scenes

from benches.splats import SIZE, fastest, grid, on_surfaces, room

COUNT = 10_506  # fine Gaussians of a default bake of Sponza
POINTS = 100_000


def c_library() -> list[dict]:
    """Fastest of 12: to decode a file, to make a light of it, to draw at two sizes, to read points."""
    from c_library import Context, Library, Light, build

    from gsgi.runtime.file import codec
    from gsgi.runtime.gaussians import Bake, SurfaceBlend
    from gsgi.runtime.gl.context import create_context
    from gsgi.runtime.gl.gbuffer import GBuffer
    from gsgi.runtime.gl.geometry import Geometry
    from gsgi.runtime.gl.indirect_light import IndirectLight
    from gsgi.runtime.lookup_tables import lookup_tables
    from gsgi.runtime.sampling import Sampler

    ctx, rows = create_context(), []
    data = codec.encode(Bake(on_surfaces(COUNT), SurfaceBlend(), coarse=grid()))
    with tempfile.TemporaryDirectory() as folder:
        options = "-DBUILD_SHARED_LIBS=ON", "-DCMAKE_BUILD_TYPE=Release"
        library = Library(build(Path(folder), *options) / "libgsgi.so")
    context = Context(library, ctx)

    def compare(what: str, python, c) -> None:
        seconds = fastest({("python",): python, ("c",): c})
        milliseconds = {key: 1e3 * seconds[key,] for key in ("python", "c")}
        row = {f"{key}_ms": round(ms, 2) for key, ms in milliseconds.items()}
        rows.append({"what": what, **row, "of_python": round(milliseconds["c"] / milliseconds["python"], 2)})

    def make_python():
        IndirectLight(ctx, codec.decode(data)).release()
        ctx.finish()

    def make_c():
        Light(context, data, python.encoding).destroy()
        ctx.finish()

    python = IndirectLight(ctx, codec.decode(data))
    c = Light(context, data, python.encoding)
    compare("decode", lambda: codec.decode(data), lambda: library.close(library.opened(data)))
    made = lambda: lookup_tables(codec.decode(data)), lambda: library.close(library.opened(data, lists=True))
    compare("decode, lists", *made)
    compare("decode, lists, upload, compile", make_python, make_c)
    camera = scenes.inside_camera()
    for size in ((8, 8), SIZE):
        gbuffer = GBuffer(ctx, Geometry(ctx, room()), size)
        gbuffer.draw(camera)
        textures = gbuffer.depth, gbuffer.interpolated
        target, albedo = ctx.framebuffer(ctx.texture(size, 4, dtype="f2")), ctx.texture(size, 4)
        matrices = np.float32(camera.view_from_world), np.float32(camera.clip_from_view(size[0] / size[1]))

        def frame_python(textures=textures, matrices=matrices, target=target, albedo=albedo):
            python.draw(*textures, *matrices)
            python.add(target, albedo)
            ctx.finish()

        def frame_c(textures=textures, matrices=matrices, target=target, albedo=albedo, size=size):
            c.cull(*matrices, (0, 0, *size))
            c.draw(*(texture.glo for texture in textures))
            c.add(target.glo, albedo.glo)
            ctx.finish()

        compare(f"draw and add, {size[0]} x {size[1]} px", frame_python, frame_c)
    rng = np.random.default_rng(0)
    points = on_surfaces(POINTS).position + rng.normal(0, 1e-3, (POINTS, 3)).astype(np.float32)
    normals = rng.normal(size=points.shape).astype(np.float32)
    sampler, bake = Sampler(codec.decode(data)), library.opened(data, sampling=True)
    compare(
        f"B at {POINTS:,} points",
        lambda: sampler.sample(points, normals),
        lambda: library.sample(bake, points, normals),
    )
    return rows
