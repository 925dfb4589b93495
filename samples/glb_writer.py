"""A small writer of .glb files, enough for the sample scenes."""

import json
import struct
import zlib

import numpy as np

LIGHTS, STRENGTH = "KHR_lights_punctual", "KHR_materials_emissive_strength"
TRANSMISSION = "KHR_materials_transmission"
FLOAT, SHORT = 5126, 5123
VERTICES, INDICES = 34962, 34963
NEAREST, REPEAT = 9728, 10497


class Glb:
    """A glTF document under construction; every `add` returns the index of what it added."""

    def __init__(self):
        self.binary = b""
        self.json = {"asset": {"version": "2.0", "generator": "gsgi samples/make_scenes.py"}}
        self.roots = []

    def add(self, kind: str, **fields) -> int:
        entries = self.json.setdefault(kind, [])
        entries.append(fields)
        return len(entries) - 1

    def view(self, data: bytes, **fields) -> int:
        self.binary += b"\0" * (-len(self.binary) % 4)
        start = len(self.binary)
        self.binary += data
        return self.add("bufferViews", buffer=0, byteOffset=start, byteLength=len(data), **fields)

    def accessor(self, values: np.ndarray, **fields) -> int:
        """Add an accessor: one column holds indices (uint16), several hold vertex attributes (float32)."""
        width = values.shape[1]
        target = INDICES if width == 1 else VERTICES
        fields["bufferView"] = self.view(values.tobytes(), target=target)
        fields["componentType"] = SHORT if width == 1 else FLOAT
        kind = "SCALAR" if width == 1 else f"VEC{width}"
        return self.add("accessors", count=len(values), type=kind, **fields)

    def material(self, name: str, color, **fields) -> int:
        """Add a rough material of albedo `color` (3,) and `alpha`. The blue of `metal_texture` scales `metallic`."""
        texture, metal_texture = fields.pop("texture", None), fields.pop("metal_texture", None)
        pbr = {
            "baseColorFactor": [*color, fields.pop("alpha", 1.0)],
            "metallicFactor": fields.pop("metallic", 0),
            "roughnessFactor": 1,
        }
        if texture is not None:
            pbr["baseColorTexture"] = {"index": texture}
        if metal_texture is not None:
            pbr["metallicRoughnessTexture"] = {"index": metal_texture}
        return self.add("materials", name=name, pbrMetallicRoughness=pbr, **fields)

    def texture(self, pixels: np.ndarray) -> int:
        image = self.add("images", bufferView=self.view(png(pixels)), mimeType="image/png")
        sampler = self.add("samplers", wrapS=REPEAT, wrapT=REPEAT, magFilter=NEAREST, minFilter=NEAREST)
        return self.add("textures", source=image, sampler=sampler)

    def mesh(self, name: str, quads: list, material: int, repeat: float = 1) -> int:
        """Add rectangles (4, 3), counter-clockwise seen from the front; the texture repeats `repeat` times."""
        position = np.concatenate(quads).astype("<f4")
        normal = np.repeat([face_normal(quad) for quad in quads], 4, axis=0).astype("<f4")
        uv = np.tile(repeat * np.array([[0, 1], [1, 1], [1, 0], [0, 0]], "<f4"), (len(quads), 1))
        index = (np.array([0, 1, 2, 0, 2, 3]) + 4 * np.arange(len(quads))[:, None]).astype("<u2")
        low, high = position.min(axis=0).tolist(), position.max(axis=0).tolist()
        attributes = {
            "POSITION": self.accessor(position, min=low, max=high),
            "NORMAL": self.accessor(normal),
            "TEXCOORD_0": self.accessor(uv),
        }
        primitive = {"attributes": attributes, "material": material}
        primitive["indices"] = self.accessor(index.reshape(-1, 1))
        return self.add("meshes", name=name, primitives=[primitive])

    def node(self, name: str, root: bool = True, **fields) -> int:
        index = self.add("nodes", name=name, **fields)
        if root:
            self.roots.append(index)
        return index

    def solid(self, name: str, quads: list, material: int) -> int:
        """Add a mesh and a root node that shows it."""
        return self.node(name, mesh=self.mesh(name, quads, material))

    def camera(self, name: str, eye, target, yfov: float):
        perspective = {"yfov": round(float(yfov), 7), "znear": 0.01, "zfar": 100}
        camera = self.add("cameras", name=name, type="perspective", perspective=perspective)
        self.node(name, camera=camera, matrix=look_at(eye, target))

    def light(self, name: str, position, rotation=(0, 0, 0, 1), **fields):
        self._use(LIGHTS)
        lights = self.json.setdefault("extensions", {LIGHTS: {"lights": []}})[LIGHTS]["lights"]
        lights.append({"name": name, **fields})
        use = {LIGHTS: {"light": len(lights) - 1}}
        self.node(name, translation=position, rotation=rotation, extensions=use)

    def emission(self, strength: float) -> dict:
        """Fields of a material that emits white light of this radiance."""
        self._use(STRENGTH)
        return {"emissiveFactor": [1, 1, 1], "extensions": {STRENGTH: {"emissiveStrength": strength}}}

    def transmission(self, factor: float) -> dict:
        """Fields of a material that lets this share of the light through, tinted by its colour."""
        self._use(TRANSMISSION)
        return {"extensions": {TRANSMISSION: {"transmissionFactor": factor}}}

    def _use(self, extension: str):
        used = self.json.setdefault("extensionsUsed", [])
        if extension not in used:
            used.append(extension)

    def encode(self) -> bytes:
        """The bytes of the .glb file."""
        binary = self.binary + b"\0" * (-len(self.binary) % 4)
        document = {**self.json, "buffers": [{"byteLength": len(self.binary)}]}
        document |= {"scene": 0, "scenes": [{"nodes": self.roots}]}
        text = json.dumps(document, separators=(",", ":")).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        chunks += struct.pack("<I4s", len(binary), b"BIN\0") + binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def png(pixels: np.ndarray) -> bytes:
    """Encode (H, W, 3 or 4) uint8 as PNG. Rows are stored, not deflated, because zlib versions deflate differently."""
    height, width, channels = pixels.shape
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    header = struct.pack(">IIBBBBB", width, height, 8, {3: 2, 4: 6}[channels], 0, 0, 0)
    chunks = ((b"IHDR", header), (b"IDAT", zlib.compress(rows, 0)), (b"IEND", b""))
    body = (struct.pack(">I", len(d)) + t + d + struct.pack(">I", zlib.crc32(t + d)) for t, d in chunks)
    return b"\x89PNG\r\n\x1a\n" + b"".join(body)


def unit(vector: np.ndarray) -> np.ndarray:
    return vector / np.sqrt((vector * vector).sum())


def face_normal(quad: np.ndarray) -> np.ndarray:
    """Unit normal of a rectangle (4, 3), from its diagonals."""
    return unit(np.cross(quad[2] - quad[0], quad[3] - quad[1]))


def look_at(eye, target) -> list[float]:
    """glTF matrix (column-major) of a camera at `eye` that looks at `target`, +Y up."""
    back = unit(np.subtract(eye, target))
    right = unit(np.cross((0, 1, 0), back))
    columns = [(*right, 0), (*np.cross(back, right), 0), (*back, 0), (*eye, 1)]
    return np.round(columns, 7).reshape(-1).tolist()
