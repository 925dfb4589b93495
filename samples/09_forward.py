"""Baked light in a forward renderer: the function gsgi_indirect() in its own fragment shader, also on blended glass.

python samples/09_forward.py [SCENE GI IMAGE]    # default: the Cornell box, a draft bake, build/samples/forward.png
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
uniform mat4 clip_from_world; in vec3 position, normal; out vec3 x, n;
void main() { x = position, n = normal; gl_Position = clip_from_world * vec4(x, 1.0); }"""
FRAGMENT = """
uniform vec3 color, glow; uniform float opacity; in vec3 x, n; out vec4 radiance;
void main() { radiance = vec4(glow + color * gsgi_indirect(x, gl_FrontFacing ? n : -n), opacity); }"""


def main(scene_file=CORNELL, gi_file: str | None = None, image_file: str | Path = OUT / "forward.png") -> None:
    """Draw the scene from its first camera, lit only by its own emission and the baked light, and a pane before it."""
    scene, ctx = gsgi.read_scene(scene_file), gsgi.create_context()
    camera = next(iter(scene.cameras.values()))
    clip_from_world = camera.clip_from_view(WIDTH / HEIGHT) @ camera.view_from_world
    lookup = gsgi.IndirectLookup(ctx, gsgi.read_bake(gi_file or draft(scene_file)))  # once
    program = ctx.program(VERTEX, "#version 330\n" + lookup.source + FRAGMENT)
    program["clip_from_world"].write(clip_from_world.T.astype("f4").tobytes())
    target = ctx.framebuffer(ctx.texture((WIDTH, HEIGHT), 4, dtype="f2"), ctx.depth_renderbuffer((WIDTH, HEIGHT)))
    target.use()
    target.clear()
    ctx.enable_only(moderngl.DEPTH_TEST)
    lookup.bind(program)

    def draw(position, normal, triangle, color, glow=(0, 0, 0), opacity=1.0) -> None:
        program["color"].value, program["glow"].value, program["opacity"].value = tuple(color), tuple(glow), opacity
        vertices = np.hstack([position, normal])[triangle.ravel()].astype(np.float32)
        ctx.vertex_array(program, [(ctx.buffer(vertices.tobytes()), "3f 3f", "position", "normal")]).render()

    for mesh in scene.meshes:
        surface = scene.materials[mesh.material]
        draw(mesh.position, mesh.normal, mesh.triangle, surface.base_color[:3], surface.emission)
    # A white pane in the middle of the scene, half transparent, that faces the camera.
    low, high = scene.bounds()
    (right, up, back), edge = camera.world_from_view[:3, :3].T, np.linalg.norm(high - low) / 10
    pane = (low + high) / 2 + edge * np.array([-right - up, right - up, right + up, -right + up])
    ctx.enable(moderngl.BLEND)
    draw(pane, np.tile(back, (4, 1)), np.array([[0, 1, 2], [0, 2, 3]]), (1, 1, 1), opacity=0.5)
    image = np.frombuffer(target.read(dtype="f2"), np.float16).reshape(HEIGHT, WIDTH, 3)[::-1].astype("f4")
    seen = to_uint8(tone_map(image, auto_exposure(image)))
    write_image(image_file, image if Path(image_file).suffix == ".exr" else seen)


if __name__ == "__main__":
    main(*sys.argv[1:])
