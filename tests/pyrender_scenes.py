"""Scenes of pyrender that tests draw with both renderers; as a script, this module writes what pyrender draws.

pyrender needs PYOPENGL_PLATFORM before its import and terminates EGL for the whole process, so it runs in its own.
"""

import os
import sys
from pathlib import Path

import numpy as np

SIZE = 96, 64


def look_at(eye, target=(0, 0, 0)) -> np.ndarray:
    """World-from-view matrix of a view at `eye` towards `target`."""
    back = np.subtract(eye, target) / np.linalg.norm(np.subtract(eye, target))
    right = np.cross((0, 1, 0), back) / np.linalg.norm(np.cross((0, 1, 0), back))
    pose = np.eye(4)
    pose[:3] = np.stack([right, np.cross(back, right), back, eye], axis=1)
    return pose


def translation(x: float, y: float, z: float) -> np.ndarray:
    """World-from-node matrix of a node at (x, y, z)."""
    pose = np.eye(4)
    pose[:3, 3] = x, y, z
    return pose


def box(size=(1, 1, 1)):
    """A box as a trimesh."""
    import trimesh

    return trimesh.creation.box(size)


def material(color=(0.8, 0.5, 0.3, 1.0), **options):
    """A rough dielectric, unless `options` change it."""
    import pyrender

    settings = {"metallicFactor": 0.0, "roughnessFactor": 0.9, "alphaMode": "OPAQUE"} | options
    return pyrender.MetallicRoughnessMaterial(baseColorFactor=color, **settings)


def empty(camera=None, eye=(1.5, 1.8, 3.0), **options):
    """A scene with a camera."""
    import pyrender

    settings = {"bg_color": (0.1, 0.2, 0.3, 0.5), "ambient_light": (0.1, 0.12, 0.14)} | options
    scene = pyrender.Scene(**settings)
    scene.add(camera or pyrender.PerspectiveCamera(0.8, znear=0.1), pose=look_at(eye))
    return scene


def add_lights(scene) -> None:
    """Add one light of each kind."""
    import pyrender

    scene.add(pyrender.DirectionalLight((1, 0.9, 0.8), 1.5), pose=look_at((1, 2, 1.5)))
    scene.add(pyrender.PointLight((0.4, 0.6, 1), 3.0), pose=translation(-1.2, 1.0, 1.0))
    spot = pyrender.SpotLight((1, 0.4, 0.4), 8.0, innerConeAngle=0.2, outerConeAngle=0.5)
    scene.add(spot, pose=look_at((0.6, 2.5, 1.5)))


def solids(camera=None, lit=True, **options):
    """A smooth ball, a box with edges and a floor, each with its own pose and material."""
    import pyrender
    import trimesh

    scene = empty(camera, **options)
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.5)
    scene.add(pyrender.Mesh.from_trimesh(ball, material((0.3, 0.6, 0.9, 1), roughnessFactor=0.4)), name="ball")
    pose = translation(0.9, 0.1, -0.4)
    pose[:3, :3] = look_at((1, 2, 3))[:3, :3] @ np.diag([0.8, 1.2, 0.5])
    scene.add(pyrender.Mesh.from_trimesh(box(), material(metallicFactor=0.7), smooth=False), pose=pose, name="box")
    floor = pyrender.Mesh.from_trimesh(box((4, 0.1, 4)), material((0.9, 0.9, 0.9, 1)), smooth=False)
    scene.add(floor, pose=translation(0, -0.6, 0), name="floor")
    if lit:
        add_lights(scene)
    return scene


def quad(**options):
    """A square of 2 m in the plane z = 0 that faces +z, uv from 0 to 1.5."""
    import pyrender

    positions = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    settings = {"normals": np.tile([0, 0, 1.0], (4, 1)), "texcoord_0": (positions[:, :2] + 1) * 0.75}
    settings |= {"indices": [[0, 1, 2], [0, 2, 3]], "material": material()} | options
    return pyrender.Mesh([pyrender.Primitive(positions, **settings)])


def image(channels: int, seed: int) -> np.ndarray:
    """A picture of a few large texels."""
    return np.random.default_rng(seed).integers(0, 256, (8, 16, channels), np.uint8)


def textured(**sampler):
    """Every texture that a metallic-roughness material has."""
    import pyrender

    def texture(channels: int, seed: int, kind: str):
        return pyrender.Texture(source=image(channels, seed), source_channels=kind, sampler=pyrender.Sampler(**sampler))

    bumps = image(3, 4) // 4 + np.array([96, 96, 191], np.uint8)
    scene = empty(eye=(0.4, 0.5, 2.5))
    scene.add(quad(material=material(
        baseColorTexture=texture(4, 1, "RGBA"), metallicRoughnessTexture=texture(3, 2, "GB"), metallicFactor=0.5,
        emissiveTexture=texture(3, 3, "RGB"), emissiveFactor=(0.4, 0.5, 0.6), normalTexture=bumps,
        occlusionTexture=texture(1, 5, "R"))))  # fmt: skip
    add_lights(scene)
    return scene


def vertex_colors():
    """Vertex colours without normals, on a double-sided material seen from behind."""
    colors = np.array([[1, 0, 0, 1], [0, 1, 0, 1], [0, 0, 1, 1], [1, 1, 0, 1.0]])
    scene = empty(eye=(0.5, 0.6, -2.5))
    scene.add(quad(color_0=colors, normals=None, material=material((1, 1, 1, 1), doubleSided=True)))
    add_lights(scene)
    return scene


def blended():
    """Two panes, one behind the other, in front of a solid box."""
    import pyrender

    scene = empty(eye=(0.3, 0.4, 3.0))
    scene.add(pyrender.Mesh.from_trimesh(box(), smooth=False), pose=translation(0, 0, -1.5))
    for z, color in ((0.0, (1, 0, 0, 0.4)), (0.5, (0, 1, 0, 0.6))):
        scene.add(quad(material=material(color, alphaMode="BLEND")), pose=translation(0.3 * z, 0, z))
    add_lights(scene)
    return scene


def instances():
    """Three poses of one primitive, below a moved parent."""
    import pyrender

    poses = np.stack([translation(x, 0.3 * x, 0) @ np.diag([1, 1 + x * x, 1, 1]) for x in (-0.8, 0.0, 0.8)])
    scene = empty()
    parent = scene.add_node(pyrender.Node(matrix=translation(0.1, -0.2, 0.3)))
    mesh = pyrender.Mesh.from_trimesh(box((0.4, 0.4, 0.4)), material(), poses=poses, smooth=False)
    scene.add(mesh, pose=look_at((1, 1, 1)), parent_node=parent)
    add_lights(scene)
    return scene


def many_lights():
    """Seven point lights; the four nearest to a mesh light it."""
    import pyrender

    scene = solids(lit=False)
    for i in range(7):
        color = np.eye(3)[i % 3]
        scene.add(pyrender.PointLight(color, 1.5), pose=translation(0.6 * i - 2, 1.2, 0.7))
    return scene


def lines():
    """A wireframe beside a line strip."""
    import pyrender

    scene = empty()
    scene.add(pyrender.Mesh.from_trimesh(box(), material(), wireframe=True))
    ring = np.array([[np.cos(a), 0.8, np.sin(a)] for a in np.linspace(0, 6, 12)])
    scene.add(pyrender.Mesh([pyrender.Primitive(ring, mode=3, material=material((1, 0, 0, 1)))]))
    return scene


def points():
    """A cloud of coloured points."""
    import pyrender

    rng = np.random.default_rng(0)
    scene = empty()
    scene.add(pyrender.Mesh.from_points(rng.uniform(-1, 1, (40, 3)), colors=rng.uniform(0, 1, (40, 3))))
    return scene


def every_primitive():
    """A row for each set of vertex attributes, a column for each mode, in front of a wall that takes their shadows."""
    import pyrender

    corners = np.array([[0, 1], [0, 0], [1, 1], [1, 0], [2, 1], [2, 0]]) / [2, 1]
    normals = np.tile([0.3, 0.2, 0.93], (6, 1)) / np.linalg.norm([0.3, 0.2, 0.93])
    tangents = np.tile([1.0, 0, 0, 1], (6, 1))
    colors = np.random.default_rng(6).uniform(0.2, 1, (6, 4)) ** [1, 1, 1, 0]
    plain, picture = material(), material(baseColorTexture=image(3, 7))
    bumpy = material(baseColorTexture=image(3, 7), normalTexture=image(3, 8) // 4 + np.array([96, 96, 191], np.uint8))
    every = {"normals": normals, "tangents": tangents, "texcoord_0": corners, "texcoord_1": corners, "color_0": colors}
    rows = [
        {},
        {"normals": normals},
        {"tangents": tangents},
        {"normals": normals, "tangents": tangents},
        {"texcoord_0": corners, "material": picture},
        {"color_0": colors},
        {"color_0": colors * [1, 1, 1, 0.5], "material": material(alphaMode="BLEND")},
        {**every, "material": bumpy},
        {**every, "indices": [5, 4, 3, 2, 1, 0], "material": bumpy},
        {**every, "poses": np.stack([np.eye(4), translation(0.05, -0.2, 0.1)]), "material": bumpy},
    ]
    scene = empty(eye=(0, 0, 3.8))
    for row, attributes in enumerate(rows):
        for mode in range(7):  # glTF's: points, lines, line loop, line strip, triangles, strip, fan
            positions = np.column_stack([corners * [0.3, 0.2], 0.1 * corners[:, 0]])
            settings = {"mode": mode, "material": plain} | attributes
            mesh = pyrender.Mesh([pyrender.Primitive(positions, **settings)])
            place = translation(0.42 * (mode - 3) - 0.15, 0.3 * (4.5 - row) - 0.1, 0)
            scene.add(mesh, pose=place, name=f"cell {row} {mode}")
    wall = translation(0, 0, -0.3) @ np.diag([2, 2, 1, 1])
    scene.add(quad(material=material((0.9, 0.9, 0.9, 1))), pose=wall, name="wall")
    add_lights(scene)
    return scene


def from_behind():
    """A square that faces away from the camera."""
    scene = empty(eye=(0.5, 0.6, -2.5))
    scene.add(quad())
    add_lights(scene)
    return scene


def with_empty_primitives():
    """A square, and primitives without vertices, indices or poses."""
    import pyrender

    scene = from_behind()
    for nothing in (
        {"positions": np.zeros((0, 3)), "mode": 0},
        {"positions": np.zeros((0, 3)), "indices": np.zeros((0, 3))},
        {"positions": np.eye(3), "indices": np.zeros((0, 3))},
        {"positions": np.eye(3), "poses": np.zeros((0, 4, 4))},
    ):
        scene.add(pyrender.Mesh([pyrender.Primitive(**nothing)]))
    return scene


def cameras() -> dict:
    """Cameras by name."""
    import pyrender

    return {
        "far": pyrender.PerspectiveCamera(0.9, znear=0.1, zfar=5.0),
        "aspect": pyrender.PerspectiveCamera(0.9, znear=0.1, aspectRatio=1.0),
        "intrinsics": pyrender.IntrinsicsCamera(80.0, 90.0, 40.0, 36.0, znear=0.1, zfar=20.0),
        "orthographic": pyrender.OrthographicCamera(1.5, 1.5, znear=0.1, zfar=10.0),
    }


# All of pyrender's flags that the drop-in draws, and some combinations: 1 DEPTH_ONLY, 2 OFFSCREEN, 4 FLIP_WIREFRAME,
# 8 ALL_WIREFRAME, 16 ALL_SOLID, 32 directional, 128 spot shadows, 1024 SKIP_CULL_FACES, 2048 RGBA, 4096 FLAT, 8192 SEG.
FLAGS = 0, 1, 2, 4, 8, 16, 32, 128, 160, 1024, 2048, 4096, 8192, 1 | 1024, 32 | 8, 128 | 2048, 4096 | 1024, 8192 | 2048

# Scene and flags.
CASES = {
    "solids": (solids, 0),
    "rgba": (solids, 2048),
    "depth_only": (solids, 1),
    "shadows": (solids, 160),
    "flat": (solids, 4096),
    "segments": (solids, 8192),
    "all_wireframe": (solids, 8),
    "textured": (textured, 0),
    "textured_flat": (textured, 4096),
    "clamped": (lambda: textured(wrapS=33071, wrapT=33071, magFilter=9728, minFilter=9728), 0),
    "vertex_colors": (vertex_colors, 0),
    "vertex_colors_flat": (vertex_colors, 4096),
    "culled": (from_behind, 0),
    "not_culled": (from_behind, 1024),
    "with_empty_primitives": (with_empty_primitives, 1024),
    "with_empty_primitives_depth": (with_empty_primitives, 1),
    "blended": (blended, 2048),
    "instances": (instances, 0),
    "instances_depth": (instances, 1),
    "many_lights": (many_lights, 0),
    "lines": (lines, 0),
    "lines_flipped": (lines, 4),
    "points": (points, 0),
    "nothing": (empty, 2048),
    **{f"every_primitive_{flags}": (every_primitive, flags) for flags in FLAGS},
    **{f"camera_{name}": (lambda name=name: solids(cameras()[name]), 0) for name in
       ("far", "aspect", "intrinsics", "orthographic")},
}  # fmt: skip


def segments(scene) -> dict:
    """Colours of nodes for RenderFlags.SEG: one for all channels, and one per channel; floor and wall have none."""
    cells = {f"cell {row} {mode}": (10 * row + 100, 20 * mode + 100, 7) for row in range(10) for mode in range(7)}
    colors = {"ball": 200, "box": (10, 20, 30)} | cells
    return {node: colors[node.name] for node in scene.mesh_nodes if node.name in colors}


def draw(renderer, name: str) -> dict[str, np.ndarray]:
    """The images of a case: "depth", and "color" unless only depth was asked for."""
    make, flags = CASES[name]
    scene = make()
    result = renderer.render(scene, flags, segments(scene))
    return {"depth": result} if flags & 1 else dict(zip(("color", "depth"), result, strict=True))


def main(path: Path) -> None:
    """Write what pyrender draws to an .npz file."""
    os.environ["PYOPENGL_PLATFORM"] = "egl"
    np.infty = np.inf  # pyrender's shadows use it, and numpy 2 does not have it
    import pyrender

    renderer = pyrender.OffscreenRenderer(*SIZE)
    np.savez(path, **{f"{name}/{kind}": x for name in CASES for kind, x in draw(renderer, name).items()})


if __name__ == "__main__":
    main(Path(sys.argv[1]))
