"""The C decoder against the Python one: the same numbers to the last bit, the same refusals, and no other reads."""

import ctypes
import re

import numpy as np
import oracle
import pytest
from c_library import (
    INVALID_ARGUMENT,
    INVALID_FILE,
    OK,
    OUT_OF_MEMORY,
    SOURCE,
    UNSUPPORTED,
    Budget,
    Info,
    OpenOptions,
    check_refusals,
)
from gsgi_files import NONSENSE, READ, STORED, changed, damaged_files, example, reseal, stored, surface_example
from surface_cases import grouped, with_coarse_slopes, with_relief

from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, SurfaceBlend
from gsgi.runtime.gl import gaussian_textures
from gsgi.runtime.rebase import local_bake, origin_of_bake
from gsgi.runtime.sampling import sample

FILES = {
    **{name: stored(name) for name in READ},
    **{f"over, degree {degree}": codec.encode(example(300, degree)) for degree in range(4)},
    **{f"surface, degree {degree}": codec.encode(surface_example(700, degree, 90, 2 - degree)) for degree in range(3)},
    "light groups": codec.encode(grouped(surface_example())),
    "relief": codec.encode(with_relief(surface_example())),
    "not sloped": codec.encode(surface_example(sloped=False)),
    "empty": codec.encode(surface_example(0, 0, 0, 0)),
}


@pytest.mark.parametrize("name", FILES)
def test_decoded_texels_are_those_of_python_to_the_last_bit(library, name):
    data = FILES[name]
    decoded, bake = codec.decode(data), library.opened(data)
    for level, gaussians in enumerate((decoded.gaussians, decoded.coarse)):
        found = library.texels(bake, level)
        if gaussians is None or not len(gaussians):
            assert found["shape"] is found["sh"] is found["slope"] is None
            continue
        expected = {"shape": gaussian_textures._shape_texels(gaussians), "sh": gaussian_textures._sh_texels(gaussians)}
        if gaussians.sloped:
            expected["slope"] = np.pad(gaussians.slope, ((0, 0), (0, 2)))
        for kind, texels in expected.items():
            texels = texels.reshape(-1, 4)
            np.testing.assert_array_equal(found[kind][: len(texels)].view(np.uint32), texels.view(np.uint32))
            assert not found[kind][len(texels) :].any()
        assert (found["slope"] is not None) == gaussians.sloped
    library.close(bake)


def test_far_from_the_origin_positions_are_relative_to_the_middle(library):
    bake = surface_example()
    for level in (bake.gaussians, bake.coarse):
        level.position[...] += np.float32([70000, -300, 2e5])
    data = codec.encode(bake)
    decoded, opened = codec.decode(data), library.opened(data)
    origin = origin_of_bake(decoded)
    assert origin.any()
    for level, gaussians in enumerate((local_bake(decoded, origin).gaussians, local_bake(decoded, origin).coarse)):
        found = library.texels(opened, level)
        np.testing.assert_array_equal(found["origin"], origin)
        np.testing.assert_array_equal(found["shape"][::3, :3][: len(gaussians)], gaussians.position)
    library.close(opened)


@pytest.mark.parametrize("name", FILES)
def test_info_is_the_header(library, name):
    decoded, bake = codec.decode(FILES[name]), library.opened(FILES[name])
    info, levels = library.info(bake), [decoded.gaussians, *([decoded.coarse] if decoded.coarse else [])]
    assert list(info.gaussian_count)[: len(levels)] == [len(level) for level in levels]
    assert list(info.sh_degree)[: len(levels)] == [level.sh_degree for level in levels]
    assert list(info.sloped)[: len(levels)] == [level.sloped for level in levels]
    assert (info.effects, info.bounces, info.scene) == (decoded.effects, decoded.bounces, decoded.scene)
    assert info.blend == isinstance(decoded.blend, SurfaceBlend)
    assert info.tone_scale == decoded.tone_scale
    for field, value in vars(decoded.blend).items():
        assert getattr(info, {"near": "near_plane", "floor": "weight_floor"}.get(field, field)) == value
    if info.blend:
        assert info.radius == np.float32(decoded.blend.radius)
    if name != "empty":
        positions = np.concatenate([level.position for level in levels]).astype(float)
        np.testing.assert_array_equal([*info.bounds_low, *info.bounds_high], [*positions.min(0), *positions.max(0)])
    assert info.bake_bytes <= 5 * len(FILES[name]) + 2**18
    sampled = library.opened(FILES[name], sampling=True)
    assert 0 <= library.info(sampled).bake_bytes - info.bake_bytes <= 310 * sum(info.gaussian_count) + 260_000
    library.close(sampled)
    library.close(bake)


@pytest.mark.parametrize(("bake", "field", "value"), NONSENSE)
def test_nonsense_is_refused_as_python_refuses_it(library, bake, field, value):
    assert check_refusals(library, changed(codec.encode(bake), field, value))


def test_coarse_slopes_are_refused_as_python_refuses_them(library):
    assert check_refusals(library, with_coarse_slopes())


@pytest.mark.parametrize("name", STORED)
def test_every_prefix_and_every_damaged_byte_is_refused_as_python_refuses_it(library, name):
    data = stored(name)
    for length in range(len(data)):
        assert check_refusals(library, data[:length])
    assert check_refusals(library, data + b"\0")
    for i in range(len(data)):
        assert check_refusals(library, data[:i] + bytes([data[i] ^ 0x55]) + data[i + 1 :])


@pytest.mark.parametrize("name", STORED)
def test_random_damage_is_refused_where_python_refuses_it(library, name):
    refused = [check_refusals(library, data) for data in damaged_files(name, 500)]
    assert 0.05 < np.mean(refused) < 0.95


def test_sanitizers_find_nothing_in_damaged_files(sanitized):
    """AddressSanitizer and UndefinedBehaviorSanitizer abort at the first read or shift that C does not allow."""
    corpus = [*FILES.values(), with_coarse_slopes()]
    corpus += [changed(codec.encode(bake), field, value) for bake, field, value in NONSENSE]
    corpus += [stored(name)[:length] for name in STORED for length in range(0, 200, 7)]
    corpus += [data for name in STORED for data in damaged_files(name, 1500)]
    small = codec.encode(with_relief(grouped(surface_example(3, 0, 2, 1))))
    corpus += [
        reseal(small[:i] + bytes([small[i] ^ 1 << k]) + small[i + 1 :]) for i in range(300, len(small)) for k in (0, 5)
    ]
    opened = sanitized("open", corpus)
    assert len(FILES) + 200 < opened < len(corpus) - 200


@pytest.mark.parametrize(
    "data", [stored("v6_surface"), FILES["light groups"], FILES["relief"]], ids=["", "light groups", "relief"]
)
def test_without_memory_it_says_so_and_keeps_none(library, data):
    results = []
    for count in range(45):
        budget = Budget(count)
        result, bake = library.open(data, OpenOptions(callbacks=budget.callbacks, sampling=1))
        if result == OK:
            assert budget.blocks
            library.close(bake)
        assert not budget.blocks
        results.append(result)
    assert set(results) == {OK, OUT_OF_MEMORY}
    assert results == sorted(results, reverse=True)


def test_structs_may_be_those_of_another_version(library):
    data = stored("v6_surface")
    short = OpenOptions()
    short.struct_size = 8
    result, bake = library.open(data, short)
    assert result == OK

    class Longer(OpenOptions):
        _fields_ = (("later", ctypes.c_int32),)

    for later, expected in ((0, OK), (1, UNSUPPORTED)):
        result, other = library.open(data, Longer(later=later))
        assert result == expected
        library.close(other)
    assert library.open(data, OpenOptions(sampling=1))[0] == OK
    none = OpenOptions()
    none.struct_size = 0
    assert library.open(data, none)[0] == INVALID_ARGUMENT

    info = Info(bounces=7)
    info.struct_size = Info.bounces.offset
    library.functions.gsgi_bake_info(bake, ctypes.byref(info))
    assert (info.effects, info.bounces) == (library.info(bake).effects, 7)
    library.close(bake)


def test_results_have_names(library):
    assert library.functions.gsgi_result_string(INVALID_FILE) == b"GSGI_INVALID_FILE"
    assert library.functions.gsgi_version() == 100
    header = (SOURCE / "gsgi.h").read_text()
    names = re.findall(r"^    (GSGI_\w+)(?: = 0)?,? *(?:/\*.*)?$", header.split("gsgi_result {")[1].split("}")[0], re.M)
    assert [library.functions.gsgi_result_string(i).decode() for i in range(len(names))] == names


# ---- B at points ----


def points(count: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(count, 3))
    return rng.uniform(-2, 2, (count, 3)), normal / np.linalg.norm(normal, axis=1, keepdims=True)


def readable_bake(degree: int = 1, sloped: bool = False) -> Bake:
    fine = oracle.random_gaussians(150, degree, seed=1, sloped=sloped)
    return Bake(fine, SurfaceBlend(floor=0.3), coarse=oracle.random_gaussians(40, 2, seed=2))


@pytest.mark.parametrize("sampling", [False, True], ids=["all", "grid"])
@pytest.mark.parametrize(("degree", "sloped"), [(0, True), (1, False), (2, True)])
def test_light_at_points_is_the_oracles(library, degree, sloped, sampling):
    data = codec.encode(readable_bake(degree, sloped))
    decoded, bake = codec.decode(data), library.opened(data, sampling)
    position, normal = points(500)
    _, expected = oracle.read_surface(decoded.gaussians, decoded.coarse, decoded.blend, position, normal)
    found = library.sample(bake, position, 3 * normal)
    np.testing.assert_allclose(found, expected, rtol=2e-4, atol=2e-5)
    np.testing.assert_allclose(found, sample(decoded, position, 3 * normal), rtol=1e-5, atol=1e-6)
    free = library.sample_free(bake, position, 3 * normal)
    np.testing.assert_allclose(free, sample(decoded, position, 3 * normal, free=True), rtol=1e-5, atol=1e-6)
    assert (expected > 0.01).mean() > 0.2
    library.close(bake)


def test_the_grid_leaves_no_gaussian_out(library):
    data = codec.encode(surface_example(2000, 1, 200, 2))
    position, normal = points(2000)
    found = []
    for sampling in (False, True):
        bake = library.opened(data, sampling)
        found.append(library.sample(bake, position * 3, normal))
        library.close(bake)
    np.testing.assert_array_equal(*found)


def test_points_that_are_no_numbers_have_no_light(library):
    bake = library.opened(codec.encode(readable_bake()), sampling=True)
    position, normal = points(6)
    position[0, 1], position[1, 2], position[2, 0] = np.nan, np.inf, 3e38
    normal[3], normal[4], normal[5] = np.nan, 0, [0, np.inf, 0]
    np.testing.assert_array_equal(library.sample(bake, position, normal), 0)
    library.close(bake)


def test_over_has_no_light_at_points(library):
    bake = library.opened(codec.encode(example()))
    arguments = [np.zeros(3, np.float32).ctypes.data_as(ctypes.c_void_p) for _ in range(3)]
    assert library.functions.gsgi_bake_sample(bake, ctypes.c_size_t(1), *arguments) == UNSUPPORTED
    library.close(bake)
