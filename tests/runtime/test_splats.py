"""Gaussians for viewers of 3D Gaussian splatting, read by readers of our own, and by Khronos's validator."""

import json
import struct

import numpy as np
import oracle
import pytest
from gsgi_files import example, surface_example
from javascript import JS, node
from surface_frames import nothing

from gsgi.baker.cli.main import run
from gsgi.runtime.constants import SH_C0
from gsgi.runtime.display import tone_map
from gsgi.runtime.errors import UsageError
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, SurfaceBlend
from gsgi.runtime.splats import EXTENSION, OPACITY_MIN, encode, splats_of
from gsgi.runtime.vectors import sphere

BAKES = {"over": example(40, 3), "over, degree 0": example(40), "surface": surface_example(40, 2)}
TURN = np.diag([-1.0, -1, 1])  # from our space to that of .ply files


def read_ply(data: bytes) -> dict[str, np.ndarray]:
    """Columns (N,) by name."""
    head, _, body = data.partition(b"end_header\n")
    lines = head.decode().splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    count = int(lines[2].removeprefix("element vertex "))
    names = [line.removeprefix("property float ") for line in lines[3:]]
    return dict(zip(names, np.frombuffer(body, "<f4").reshape(count, len(names)).T, strict=True))


def read_glb(data: bytes) -> tuple[dict, dict[str, np.ndarray]]:
    """The JSON, and the attributes of the one primitive."""
    magic, version, length, size, kind = struct.unpack_from("<4sIII4s", data)
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    root, binary = json.loads(data[20 : 20 + size]), data[28 + size :]
    assert struct.unpack_from("<I4s", data, 20 + size) == (len(binary), b"BIN\0")
    attributes = {}
    for name, index in root["meshes"][0]["primitives"][0]["attributes"].items():
        accessor = root["accessors"][index]
        view, width = root["bufferViews"][accessor["bufferView"]], {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        dtype = {5126: "<f4", 5121: "u1"}[accessor["componentType"]]
        values = np.frombuffer(binary, dtype, width * accessor["count"], view["byteOffset"])
        assert values.nbytes == view["byteLength"]
        attributes[name] = values.reshape(-1, width)
    return root, attributes


def covariances(rotation, scale) -> np.ndarray:
    axes = oracle.rotation_matrix(rotation) * scale[:, None]
    return axes @ axes.transpose(0, 2, 1)


@pytest.mark.parametrize("name", BAKES)
def test_a_ply_holds_the_shapes_and_what_is_seen_of_the_light(name):
    bake = BAKES[name]
    level, splats = bake.gaussians, splats_of(bake)
    found = read_ply(encode(splats, "a.ply"))
    stack = lambda *names: np.stack([found[name] for name in names], axis=1).astype(float)  # noqa: E731
    np.testing.assert_allclose(stack(*"xyz"), level.position @ TURN, rtol=1e-6)
    rotation, scale = stack("rot_1", "rot_2", "rot_3", "rot_0"), np.exp(stack("scale_0", "scale_1", "scale_2"))
    expected = TURN @ covariances(level.rotation, level.scale) @ TURN
    np.testing.assert_allclose(covariances(rotation, scale), expected, rtol=1e-4, atol=1e-6)
    opacity = 1 / (1 + np.exp(-found["opacity"].astype(float)))
    np.testing.assert_allclose(opacity, np.clip(level.opacity, OPACITY_MIN, 1 - OPACITY_MIN), rtol=1e-5)

    # Colours as viewers compute them: channel by channel, and the other bands after the first.
    dc, rest = stack("f_dc_0", "f_dc_1", "f_dc_2"), [found[name] for name in found if name.startswith("f_rest")]
    degree = int((1 + len(rest) / 3) ** 0.5) - 1
    sh = np.concatenate([dc[:, None], np.reshape(rest, (3, -1, len(dc))).T], axis=1)
    assert degree == (3 if name == "over" else 0)
    directions = sphere(100)
    shown = 0.5 + np.einsum("dk,nkc->ndc", oracle.sh_basis(directions @ TURN, degree), sh)
    if name == "surface":
        normals = oracle.rotation_matrix(level.rotation)[:, :, 2]
        light = np.einsum("nk,nkc->nc", oracle.sh_basis(normals, 2), level.sh)[:, None].repeat(100, axis=1)
    else:
        light = np.einsum("dk,nkc->ndc", oracle.sh_basis(directions, degree), level.sh)
    light = np.maximum(light, 0)
    display = tone_map(light, splats.exposure)
    error = np.abs(shown - display)
    assert display.std() > 0.1
    if degree:  # a tone curve leaves more bands than there are
        assert np.sqrt(np.square(error).mean()) < 0.1
    else:
        assert error.max() < 1e-5


@pytest.mark.parametrize("name", BAKES)
def test_a_glb_holds_the_same(name):
    bake = BAKES[name]
    splats = splats_of(bake)
    root, found = read_glb(encode(splats, "a.glb"))
    primitive = root["meshes"][0]["primitives"][0]
    assert primitive["mode"] == 0
    assert root["extensionsUsed"] == [EXTENSION]
    assert primitive["extensions"] == {EXTENSION: {"kernel": "ellipse", "colorSpace": "srgb_rec709_display"}}
    for attribute, expected in (
        ("POSITION", bake.gaussians.position), (f"{EXTENSION}:ROTATION", bake.gaussians.rotation),
        (f"{EXTENSION}:SCALE", bake.gaussians.scale), (f"{EXTENSION}:OPACITY", splats.opacity[:, None]),
    ):  # fmt: skip
        np.testing.assert_array_equal(found[attribute], expected)
    names = [f"{EXTENSION}:SH_DEGREE_{band}_COEF_{i}" for band in range(4) for i in range(2 * band + 1)]
    coefficients = [found[attribute] for attribute in names if attribute in found]
    np.testing.assert_array_equal(np.stack(coefficients, axis=1), splats.sh)
    color = np.clip(0.5 + SH_C0 * splats.sh[:, 0], 0, 1)
    np.testing.assert_allclose(found["COLOR_0"][:, :3] / 255, color, atol=0.5 / 255 + 1e-6)
    accessor = root["accessors"][0]
    np.testing.assert_array_equal(
        [accessor["min"], accessor["max"]], [found["POSITION"].min(0), found["POSITION"].max(0)]
    )


def test_a_valid_glb_but_for_names_that_the_validator_does_not_know(tmp_path):
    if not (JS / "node_modules" / "gltf-validator").exists():
        pytest.skip("gltf-validator is not installed: npm ci in runtime/js")
    (tmp_path / "a.glb").write_bytes(encode(splats_of(BAKES["over"]), "a.glb"))
    script = (
        f'import validator from "{JS}/node_modules/gltf-validator/index.js"; import {{ readFileSync }} from "node:fs";'
        f'const report = await validator.validateBytes(new Uint8Array(readFileSync("{tmp_path}/a.glb")));'
        "console.log(JSON.stringify(report.issues.messages))"
    )
    issues = json.loads(node("--input-type=module", "--eval", script))
    unknown = [issue for issue in issues if f"/{EXTENSION}:" in issue["pointer"]]
    assert {issue["code"] for issue in unknown} == {"MESH_PRIMITIVE_INVALID_ATTRIBUTE"}
    assert len(unknown) == 3 + 16
    others = [issue["code"] for issue in issues if issue not in unknown]
    assert others == ["UNSUPPORTED_EXTENSION"]


def test_the_same_bake_gives_the_same_bytes():
    for ending in ("a.ply", "a.glb"):
        assert encode(splats_of(BAKES["over"]), ending) == encode(splats_of(BAKES["over"]), ending)


def test_a_bake_without_gaussians_is_refused():
    with pytest.raises(UsageError, match="no Gaussians"):
        splats_of(Bake(nothing(), SurfaceBlend(), coarse=nothing()))


def test_the_command_writes_both_and_names_what_is_wrong(tmp_path, capfd):
    bake = tmp_path / "room.gsgi"
    bake.write_bytes(codec.encode(BAKES["surface"]))
    for ending in ("ply", "glb"):
        out = tmp_path / f"room.{ending}"
        assert run(["export", str(bake), "-o", str(out), "-q"]) == 0
        message = capfd.readouterr().err
        assert message.startswith(f"wrote {out}: 40 Gaussians at exposure ")
        assert message.endswith(f", {out.stat().st_size} bytes\n")
    assert run(["export", str(bake), "-o", str(tmp_path / "room.npz")]) == 1
    assert "room.npz: Gaussians are written as .ply or .glb, probes with --probes" in capfd.readouterr().err
    assert run(["export", str(bake)]) == 1
    assert "needed is -o OUT" in capfd.readouterr().err
