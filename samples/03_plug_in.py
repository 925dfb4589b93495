"""Add baked light, by three calls of IndirectLight, to a renderer with its own shaders, targets and matrices.

python samples/03_plug_in.py [SCENE GI IMAGE]    # default: the Cornell box, a draft bake, build/samples/plug_in.png
"""

import sys
from pathlib import Path

import moderngl
import numpy as np
from draft import CORNELL, OUT, draft

import gsgi
from gsgi.runtime.display import auto_exposure, to_uint8, tone_map
from gsgi.runtime.image import write_image

WIDTH, HEIGHT = 320, 240
VERTEX = """#version 330
uniform mat4 view, projection; in vec3 position, normal; out vec3 n;
void main() { n = normal; gl_Position = projection * view * vec4(position, 1.0); }"""
FRAGMENT = """#version 330
uniform vec3 color, glow; in vec3 n;
layout(location = 0) out vec4 radiance; layout(location = 1) out vec4 albedo; layout(location = 2) out vec4 normals;
void main() {
    radiance = vec4(glow, 1.0), albedo = vec4(color, 1.0);
    normals = vec4(0.5 + 0.5 * normalize(gl_FrontFacing ? n : -n), 1.0);
}"""


def main(scene_file=CORNELL, gi_file: str | None = None, image_file: str | Path = OUT / "plug_in.png") -> None:
    """Draw the scene from its first camera, lit only by its own emission and the baked light."""
    scene, ctx = gsgi.read_scene(scene_file), gsgi.create_context()
    camera = next(iter(scene.cameras.values()))
    view, projection = camera.view_from_world, camera.clip_from_view(WIDTH / HEIGHT)
    radiance, albedo, normals = (ctx.texture((WIDTH, HEIGHT), 4, dtype=t) for t in ("f2", "f1", "f2"))
    depth = ctx.depth_texture((WIDTH, HEIGHT))
    bake = gsgi.read_bake(gi_file or draft(scene_file))
    light = gsgi.IndirectLight(ctx, bake, gsgi.Encoding("window", "unsigned"))  # once

    gbuffer, program = ctx.framebuffer([radiance, albedo, normals], depth), ctx.program(VERTEX, FRAGMENT)
    gbuffer.use()
    gbuffer.clear()
    ctx.enable_only(moderngl.DEPTH_TEST)
    program["view"].write(view.T.astype("f4").tobytes())
    program["projection"].write(projection.T.astype("f4").tobytes())
    for mesh in scene.meshes:
        surface = scene.materials[mesh.material]
        program["color"].value, program["glow"].value = tuple(surface.base_color[:3]), tuple(surface.emission)
        vertices = np.hstack([mesh.position, mesh.normal])[mesh.triangle.ravel()].astype(np.float32)
        ctx.vertex_array(program, [(ctx.buffer(vertices.tobytes()), "3f 3f", "position", "normal")]).render()

    light.draw(depth, normals, view, projection)  # each frame and camera
    light.add(ctx.framebuffer(radiance), albedo)
    image = np.frombuffer(radiance.read(), np.float16).reshape(HEIGHT, WIDTH, 4)[::-1, :, :3].astype("f4")
    seen = to_uint8(tone_map(image, auto_exposure(image)))
    write_image(image_file, image if Path(image_file).suffix == ".exr" else seen)


if __name__ == "__main__":
    main(*sys.argv[1:])
