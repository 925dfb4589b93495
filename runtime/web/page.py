"""The files of a page that shows a scene under its baked light: the viewer in runtime/js/page, and what it reads."""

import json
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from hashlib import blake2b
from pathlib import Path

import numpy as np

from gsgi.runtime.as_baked import as_baked
from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.light_groups import group_names, group_of, names_of, patterns_of
from gsgi.runtime.metals import lambertian
from gsgi.runtime.rebase import local_camera, local_scene, origin_of
from gsgi.runtime.sampling import check_operator
from gsgi.runtime.scene import Camera, Environment, Light, Material, Mesh, Scene, TextureSlot

JS = Path(__file__).parents[1] / "js"
PAGE = "index.html", "page.js", "scene.js", "fly.js", "shaders.js", "three.js", "three.LICENSE"
MODULES = tuple(sorted({path.name for path in JS.glob("*.js")} - {"index.js"}))
DESCRIPTION, DATA, LIGHT, ENVIRONMENT = "scene.json", "scene.bin", "light.gsgi", "environment.bin"
GENERATOR = "gsgi"  # in the description of every page of ours
LOSSLESS_TEXELS = 256 * 256  # larger opaque images become JPEG files, which take a tenth of the bytes
JPEG_QUALITY = 92
ALIGNMENT = 4  # bytes; of typed arrays in JavaScript


def write_page(folder: Path, scene: Scene, bake: Bake, light: bytes, cameras: dict[str, Camera], title: str) -> int:
    """Write all files of the page into an empty `folder`; return their size in bytes.

    `light` are the bytes of the file that holds `bake`; there is at least one camera. Raises UnsupportedError for a
    bake of the `over` operator, whose light is no function of a point, and for a scene without triangles.
    """
    check_operator(bake)
    if not scene.meshes:
        raise UnsupportedError("the scene has no triangles: there is nothing to show")
    origin = origin_of(scene)
    bounds = [corner - origin for corner in scene.bounds()]
    scene = lambertian(as_baked(local_scene(scene, origin) if origin.any() else scene, bake))
    data = _Arrays()
    batches = _batches(scene)
    keys = sorted({(meshes[0].material, meshes[0].color is not None) for meshes in batches})
    images, textures = _textures(scene)
    names = _write_images(folder, images)
    means = [np.rint(pixels.mean(axis=(0, 1))).astype(int).tolist() for pixels in images]
    files = {LIGHT: light}
    description = {
        "generator": GENERATOR,
        "title": title,
        "about": f"{len(bake.gaussians) + len(bake.coarse)} Gaussians, {len(light)} bytes of light.",
        "origin": origin.tolist(),
        "bounds": [corner.tolist() for corner in bounds],
        "cameras": [_camera(name, local_camera(camera, origin)) for name, camera in cameras.items()],
        "lights": [
            _light(light) | _group(light, bake) for light in sorted(scene.lights, key=lambda light: -light.color.max())
        ],
        "materials": [_material(scene, *key) | _group(scene.materials[key[0]], bake) for key in keys],
        "meshes": [_mesh(data, scene, meshes, keys) for meshes in batches],
        "textures": textures,
        "images": [{"file": name, "mean": mean} for name, mean in zip(names, means, strict=True)],
        "data": DATA,
        "light": LIGHT,
        "environment": None,
        "groups": list(group_names(bake)),
    }
    files[DATA] = b"".join(data.parts)
    if scene.environment is not None:
        height, width = scene.environment.radiance.shape[:2]
        texels = np.ones((height, width, 4), np.float16)
        texels[..., :3] = np.minimum(scene.environment.radiance, np.finfo(np.float16).max)
        files[ENVIRONMENT] = texels.tobytes()
        description["environment"] = {
            "file": ENVIRONMENT, "width": width, "height": height, "rotation": scene.environment.rotation,
        } | _group(scene.environment, bake)  # fmt: skip
    loaded = sum(map(len, files.values())) + sum((folder / name).stat().st_size for name in names)
    files[DESCRIPTION] = json.dumps(description | {"bytes": loaded}, indent=1).encode()
    files |= {name: (JS / "page" / name).read_bytes() for name in PAGE}
    files |= {f"gsgi/{name}": (JS / name).read_bytes() for name in MODULES}
    (folder / "gsgi").mkdir()
    for name, content in files.items():
        (folder / name).write_bytes(content)
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


class _Arrays:
    """Arrays one after another in one file."""

    def __init__(self):
        self.parts: list[bytes] = []
        self._size = 0

    def add(self, array: np.ndarray) -> int:
        """Append the array; return where it begins."""
        data, begin = array.tobytes(), self._size
        assert not len(data) % ALIGNMENT, array.dtype
        self.parts.append(data)
        self._size += len(data)
        return begin


def _batches(scene: Scene) -> list[list[Mesh]]:
    """Meshes that are drawn at once: all of one material that have vertex colours, or all that have none.

    That is what runtime/gl/geometry.py does. Partly transparent ones, which are sorted, are drawn one by one. What is
    not drawn and casts no shadow is left out.
    """
    groups: dict[tuple[int, bool], list[Mesh]] = {}
    for mesh in scene.meshes:
        if len(mesh.triangle) and scene.materials[mesh.material].shadow_cutoff != np.inf:
            groups.setdefault((mesh.material, mesh.color is not None), []).append(mesh)
    return [groups[key] for key in sorted(groups)] + [[mesh] for mesh in scene.blended]


def _mesh(data: _Arrays, scene: Scene, meshes: list[Mesh], keys: list[tuple[int, bool]]) -> dict:
    material, colored = meshes[0].material, meshes[0].color is not None
    attributes = {"position": [m.position for m in meshes], "normal": [m.normal for m in meshes]}
    if colored:
        attributes["color"] = [m.color for m in meshes]
    if scene.materials[material].normal_texture is not None:
        attributes["tangent"] = [m.tangent for m in meshes]
    for channel in sorted({slot.uv for slot in scene.materials[material].slots()}):
        attributes[f"uv{channel or ''}"] = [m.uv[:, channel] for m in meshes]
    arrays = {name: np.concatenate(parts).astype(np.float32) for name, parts in attributes.items()}
    return {
        "material": keys.index((material, colored)),
        "attributes": {
            name: {"offset": data.add(array), "size": array.shape[1], "count": len(array)}
            for name, array in arrays.items()
        },
        "index": _index(data, meshes),
    }


def _index(data: _Arrays, meshes: Sequence[Mesh]) -> dict:
    first = np.cumsum([0] + [len(mesh.position) for mesh in meshes[:-1]])
    index = np.concatenate([mesh.triangle + start for mesh, start in zip(meshes, first, strict=True)])
    return {"offset": data.add(index.astype(np.uint32)), "count": index.size}


def _material(scene: Scene, index: int, colored: bool) -> dict:
    material = scene.materials[index]
    return {
        "name": material.name,
        "color": list(material.base_color[:3]),
        "alpha": material.base_color[3],
        "alphaCutoff": _shadow_cutoff(material) if material.stand_in else material.alpha_cutoff,
        "map": _slot(material.base_color_texture),
        "metallic": material.metallic,
        "metallicMap": _slot(material.metallic_texture),
        "normalMap": _slot(material.normal_texture),
        "normalScale": material.normal_scale,
        "emission": [0.0] * 3 if material.unlit else list(material.emission),
        "emissionMap": _slot(material.emission_texture),
        "doubleSided": material.double_sided,
        "unlit": material.unlit,
        "colored": colored,
        "blended": any(mesh.material == index for mesh in scene.blended),
        "standIn": material.stand_in,
    }


def _shadow_cutoff(material: Material) -> float | None:
    """The cut-off for shadow maps of three.js, which compare it with the alpha of the texture alone."""
    cutoff, factor = material.shadow_cutoff, material.base_color[3]
    return cutoff / factor if cutoff and factor else cutoff


def _slot(slot: TextureSlot | None) -> dict | None:
    return None if slot is None else {"texture": slot.texture, "uv": slot.uv}


def _group(source: Light | Material | Environment, bake: Bake) -> dict:
    """The light group whose weight dims the light of a source, where there are groups."""
    return {"group": group_of(names_of(source), patterns_of(bake))} if bake.groups else {}


def _light(light: Light) -> dict:
    """JSON has no infinity: a range of None is unlimited."""
    return {
        "kind": light.kind,
        "color": np.asarray(light.color, float).tolist(),
        "position": np.asarray(light.position, float).tolist(),
        "direction": np.asarray(light.direction, float).tolist(),
        "range": float(light.range) if np.isfinite(light.range) else None,
        "cosInner": float(light.cos_inner),
        "cosOuter": float(light.cos_outer),
    }


def _camera(name: str, camera: Camera) -> dict:
    return {
        "name": name,
        "worldFromView": camera.world_from_view.T.ravel().tolist(),  # column by column
        "yfov": float(camera.yfov),
        "znear": float(camera.znear),
        "zfar": float(camera.zfar) if np.isfinite(camera.zfar) else None,
    }


def _textures(scene: Scene) -> tuple[list[np.ndarray], list[dict]]:
    """The images that materials use, each once, and a record per texture."""
    shown = {mesh.material for mesh in (*scene.meshes, *scene.blended)}
    used = {slot.texture for index in shown for slot in scene.materials[index].slots()}
    images: dict[bytes, tuple[int, np.ndarray]] = {}  # by a hash: some files hold an image several times
    records = []
    for index, texture in enumerate(scene.textures):
        image = None
        if index in used:
            key = blake2b(texture.pixels).digest() + str(texture.pixels.shape).encode()
            image = images.setdefault(key, (len(images), texture.pixels))[0]
        records.append({"image": image, "wrap": list(texture.wrap), "nearest": texture.nearest})
    return [pixels for _, pixels in images.values()], records


def _write_images(folder: Path, images: Sequence[np.ndarray]) -> list[str]:
    """Write PNG and JPEG files; return their names."""
    names = []
    for number, pixels in enumerate(images):
        opaque = bool((pixels[..., 3] == 255).all())
        kind = "jpg" if opaque and pixels.shape[0] * pixels.shape[1] > LOSSLESS_TEXELS else "png"
        names.append(f"image{number}.{kind}")
    with ThreadPoolExecutor() as pool:
        list(pool.map(_write_image, [folder / name for name in names], images))
    return names


def _write_image(path: Path, pixels: np.ndarray) -> None:
    import OpenImageIO as oiio  # noqa: N813

    height, width = pixels.shape[:2]
    channels = 3 if path.suffix == ".jpg" else 4
    spec = oiio.ImageSpec(width, height, channels, "uint8")
    spec.attribute("compression", f"jpeg:{JPEG_QUALITY}" if channels == 3 else "zip")
    spec.attribute("jpeg:subsampling", "4:4:4")
    spec.attribute("oiio:UnassociatedAlpha", 1)
    output = oiio.ImageOutput.create(path.suffix[1:])
    content = np.ascontiguousarray(pixels[..., :channels])
    if not output.open(str(path), spec) or not output.write_image(content) or not output.close():
        raise OSError(output.geterror())
