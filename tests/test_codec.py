"""The .gsgi codec: round trip within the quantisation steps, FORMAT.md, and damaged files."""

import re
import struct
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gsgi.runtime import codec, constants
from gsgi.runtime.errors import FormatError
from gsgi.runtime.gaussians import Bake, Effects, Gaussians, OverBlend

FORMAT = Path(codec.__file__).with_name("FORMAT.md").read_text(encoding="utf-8")
DATA = Path(__file__).with_name("data")


def example(count: int = 200, degree: int = 0, seed: int = 7) -> Bake:
    rng = np.random.default_rng(seed)
    rotation = rng.normal(size=(count, 4))
    rotation /= np.linalg.norm(rotation, axis=1, keepdims=True)
    sh = rng.normal(size=(count, (degree + 1) ** 2, 3)) * 0.3
    sh[:, 0] = rng.exponential(size=(count, 3)) * 10 ** rng.uniform(-3, 3, (count, 1))
    sh[:, 1:] *= sh[:, :1]
    gaussians = Gaussians(
        position=rng.uniform([-3, 0, -7], [4, 2, 9], (count, 3)).astype(np.float32),
        rotation=rotation.astype(np.float32),
        scale=np.exp(rng.uniform(-6, 0, (count, 3))).astype(np.float32),
        opacity=rng.uniform(0, 1, count).astype(np.float32),
        sh=sh.astype(np.float32),
    )
    effects = Effects.PUNCTUAL | Effects.DENOISED | Effects.UNLIT
    return Bake(
        gaussians, OverBlend(near=0.01), tone_scale=0.7, effects=effects, bounces=300, scene=0xFEDC_BA98_7654_3210
    )


def reseal(data: bytes) -> bytes:
    """The same bytes with a fitting checksum."""
    data = data[:8] + bytes(4) + data[12:]
    return data[:8] + struct.pack("<I", zlib.crc32(data)) + data[12:]


def stored(version: int) -> bytes:
    """The file of `version`: three Gaussians of degree 1."""
    return (DATA / f"v{version}.gsgi").read_bytes()


def changed(data: bytes, field: str, value) -> bytes:
    """The same file with another value in its header, resealed."""
    layout = codec.HEADERS[codec.version(data)]
    header = np.frombuffer(data, layout, 1).copy()
    header[field] = value
    return reseal(header.tobytes() + data[layout.itemsize :])


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_round_trip_stays_within_the_quantisation_steps(degree):
    bake = example(degree=degree)
    before = bake.gaussians
    decoded = codec.decode(codec.encode(bake))
    after = decoded.gaussians
    header = np.frombuffer(codec.encode(bake), codec.HEADER, 1)[0]
    slack = 1.001  # float32 rounding of the decoded value itself

    assert (np.abs(after.position - before.position) <= header["position_step"] / 2 * slack + 1e-6).all()
    log_error = np.abs(np.log(after.scale) - np.log(before.scale))
    assert log_error.max() <= header["log_scale_step"] / 2 * slack + 1e-6
    assert np.abs(after.opacity - before.opacity).max() <= 1 / 510 * slack
    dc_step = before.sh[:, 0].max(axis=1, keepdims=True) / 512
    assert (np.abs(after.sh[:, 0] - before.sh[:, 0]) <= dc_step * slack).all()
    rest_step = header["sh_rest_step"] / 2 * after.sh[:, :1].max(axis=2, keepdims=True)
    assert (np.abs(after.sh[:, 1:] - before.sh[:, 1:]) <= rest_step * slack + 1e-6).all()
    # q and -q are one rotation; four components of error 0.0007 each turn it by less than 0.004 rad.
    alignment = np.abs((after.rotation * before.rotation).sum(axis=1))
    assert (2 * np.arccos(np.clip(alignment, 0, 1)) < 0.004).all()
    assert (decoded.tone_scale, decoded.effects) == (np.float32(0.7), bake.effects)
    assert (decoded.bounces, decoded.scene) == (bake.bounces, bake.scene)
    assert decoded.blend.near == np.float32(0.01)


def test_encoding_is_idempotent_after_the_first_quantisation():
    once = codec.decode(codec.encode(example(degree=2)))
    twice = codec.decode(codec.encode(once)).gaussians
    np.testing.assert_allclose(twice.position, once.gaussians.position, atol=1e-6)
    np.testing.assert_array_equal(twice.opacity, once.gaussians.opacity)
    np.testing.assert_array_equal(twice.sh[:, 0], once.gaussians.sh[:, 0])


def test_the_encoder_is_deterministic():
    assert codec.encode(example()) == codec.encode(example())


@pytest.mark.parametrize("count", [0, 1])
def test_tiny_sets_round_trip(count):
    decoded = codec.decode(codec.encode(example(count, degree=1)))
    assert len(decoded.gaussians) == count
    np.testing.assert_allclose(decoded.gaussians.position, example(count, degree=1).gaussians.position, atol=1e-6)


def test_degenerate_values_survive():
    bake = example(4)
    bake.gaussians.scale[:] = [[0, 0, 0], [1e30, 1e-30, 1], [1, 1, 1], [2, 2, 2]]
    bake.gaussians.sh[0] = 0
    bake.gaussians.sh[1] = 1e30
    bake.gaussians.rotation[2] = 0
    after = codec.decode(codec.encode(bake)).gaussians
    assert all(np.isfinite(getattr(after, f)).all() for f in ("position", "rotation", "scale", "opacity", "sh"))
    np.testing.assert_allclose(np.linalg.norm(after.rotation, axis=1), 1, rtol=1e-6)
    assert after.sh[0].max() == 0


@pytest.mark.parametrize("version", codec.HEADERS)
def test_every_prefix_is_refused(version):
    data = stored(version)
    for length in range(len(data)):
        with pytest.raises(FormatError, match="byte"):
            codec.decode(data[:length])
    with pytest.raises(FormatError, match="byte"):
        codec.decode(data + b"\0")


@pytest.mark.parametrize("version", codec.HEADERS)
def test_every_damaged_byte_is_noticed(version):
    data = stored(version)
    for i in range(len(data)):
        with pytest.raises(FormatError):
            codec.decode(data[:i] + bytes([data[i] ^ 0x55]) + data[i + 1 :])


@pytest.mark.parametrize(
    ("field", "value"),
    [
        *[("version", 0), ("version", 1), ("version", 3), ("header_bytes", 76), ("header_bytes", 90), ("reserved", 1)],
        *[("operator", 9), ("sh_degree", 4), ("effects", 0x100), ("effects", 0x8000), ("gaussian_count", 2**31)],
        *[("near", np.nan), ("near", -1), ("dilation", np.inf), ("alpha_min", 0), ("alpha_max", 1)],
        *[("tone_scale", 0), ("position_step", 3e38), ("log_scale_min", 60), ("log_scale_step", -1)],
    ],
)
def test_resealed_nonsense_is_refused(field, value):
    with pytest.raises(FormatError, match="expected"):
        codec.decode(changed(codec.encode(example(2)), field, value))


@pytest.mark.parametrize(("field", "value"), [("header_bytes", 88), ("effects", 0x10), ("version", 2)])
def test_version_1_has_no_part_of_version_2(field, value):
    with pytest.raises(FormatError, match="expected"):
        codec.decode(changed(stored(1), field, value))


@pytest.mark.parametrize("change", [{"bounces": -1}, {"bounces": 1 << 16}, {"scene": 1 << 64}, {"effects": 0x100}])
def test_what_the_header_cannot_hold_is_not_written(change):
    with pytest.raises(AssertionError):
        codec.encode(replace(example(1), **change))


def test_a_hostile_count_allocates_nothing():
    with pytest.raises(FormatError, match="expected 301989976 bytes"):
        codec.decode(changed(codec.encode(example(0)), "gaussian_count", codec.GAUSSIAN_COUNT_MAX))


def test_rgb9e5_matches_its_definition():
    rgb = np.array([[1.0, 0.5, 0.25], [65408, 0, 1], [1e9, 0, 0], [0, 0, 0], [511.9, 1, 2], [1e-9, 1e-6, 0]])
    back = codec._unpack_rgb9e5(codec._pack_rgb9e5(rgb))
    assert back[0].tolist() == [1.0, 0.5, 0.25]
    assert back[1, 0] == back[2, 0] == 65408
    assert back[4, 0] == 512  # rounds up into the next exponent
    assert np.abs(back - np.minimum(rgb, 65408)).max(axis=1)[5] < 2**-24


def test_format_md_states_the_header_that_the_codec_uses():
    rows = re.findall(r"^\| (\d+) \| (\S+(?: x \d)?) \| (\w+) \|", FORMAT, re.MULTILINE)
    stated = [(int(offset), kind, name) for offset, kind, name in rows]
    actual = []
    for name in codec.HEADER.names:
        kind, offset = codec.HEADER.fields[name]
        base = kind.base.str.lstrip("<|")
        actual.append((offset, base + (f" x {kind.shape[0]}" if kind.shape else ""), name))
    assert stated == actual


def test_format_md_states_the_effects():
    rows = re.findall(r"^\| (\d+) \| (\w+) \| ", FORMAT.split("| bit |")[1].split("\n\n")[0], re.MULTILINE)
    assert rows == [(str(effect.value), effect.name.lower()) for effect in Effects]
    assert sum(Effects) == codec.EFFECT_BITS[codec.VERSION]


def test_format_md_states_the_size_of_a_header_of_version_1():
    size = re.search(r"\*\*Version 1\*\* has a header of (\d+) bytes", FORMAT)[1]
    assert int(size) == codec.HEADER_1.itemsize
    assert codec.HEADER_1.names == codec.HEADER.names[: codec.HEADER.names.index("sh_rest_step") + 1]


def test_format_md_states_the_arrays_in_order_and_the_size():
    section = FORMAT.split("## Arrays")[1].split("**rotation**")[0]
    names = [name for _, name in re.findall(r"^\| ([iu]\d[^|]*) \| (\w+) \|", section, re.MULTILINE)]
    assert names == list(codec.planes(1, 1).names)
    header, fixed, rest = map(int, re.search(r"(\d+) \+ N \* \((\d+) \+ (\d+) \* \(K - 1\)\)", FORMAT).groups())
    for degree in range(4):
        size = header + 5 * (fixed + rest * ((degree + 1) ** 2 - 1))
        assert len(codec.encode(example(5, degree))) == size


@pytest.mark.parametrize("version", codec.HEADERS)
def test_files_of_all_versions_stay_readable(version):
    assert codec.version(stored(version)) == version
    bake = codec.decode(stored(version))
    assert (len(bake.gaussians), bake.gaussians.sh_degree) == (3, 1)
    np.testing.assert_allclose(bake.gaussians.position, example(3, 1).gaussians.position, atol=1e-3)
    expected = example(3, 1).gaussians.sh[:, 0]
    assert (np.abs(bake.gaussians.sh[:, 0] - expected) <= expected.max(axis=1, keepdims=True) / 511).all()
    assert bake.blend.dilation == np.float32(constants.DILATION)


def test_what_a_file_lacks_is_unknown():
    old, new = (codec.decode(stored(version)) for version in (1, 2))
    assert (old.bounces, old.scene, old.effects) == (0, 0, Effects.PUNCTUAL | Effects.DENOISED)
    assert (new.bounces, new.scene, new.effects) == (300, 0xFEDC_BA98_7654_3210, old.effects | Effects.UNLIT)
    assert codec.version(codec.encode(old)) == codec.VERSION
