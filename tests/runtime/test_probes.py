"""The grid of SH probes: it gives back the light that it was read from."""

import io
import json

import numpy as np
import oracle
import pytest
from surface_frames import nothing, one

import gsgi
from gsgi.baker.cli.main import run
from gsgi.runtime.errors import UsageError
from gsgi.runtime.file import codec
from gsgi.runtime.gaussians import Bake, Gaussians, SurfaceBlend
from gsgi.runtime.probes import PROBES_MAX, encode, probe_grid


def bake_of_degree_2(seed: int = 0) -> Bake:
    """Light that SH of degree 2 hold exactly: of the coarse level alone, bright enough to be nowhere negative."""
    rng = np.random.default_rng(seed)
    coarse = Gaussians(
        rng.uniform(-1, 1, (20, 3)).astype(np.float32),
        np.tile(np.float32([0, 0, 0, 1]), (20, 1)),
        np.full((20, 3), 1.5, np.float32),
        np.ones(20, np.float32),
        (0.2 * rng.normal(size=(20, 9, 3)) + np.eye(9, 1)[:, :, None].T.reshape(1, 9, 1) * 6).astype(np.float32),
    )
    fine = Gaussians(*(np.repeat(getattr(one(scale=(0.01,) * 3), name), 2, axis=0)
                       for name in ("position", "rotation", "scale", "opacity", "sh")))  # fmt: skip
    fine.position[:] = [[-1, -0.5, 0], [1, 0.5, 3]]
    return Bake(fine, SurfaceBlend(), coarse=coarse)


def test_probes_give_the_light_of_every_normal():
    bake = bake_of_degree_2()
    grid = probe_grid(bake, 0.5)
    assert grid.sh.shape == (4, 2, 6, 9, 3)
    np.testing.assert_allclose(grid.first, [-0.75, -0.25, 0.25])
    normal = np.random.default_rng(1).normal(size=(100, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    basis = oracle.sh_basis(normal, 2)
    for probe in ((0, 0, 0), (3, 1, 2), (2, 0, 5)):
        position = np.tile(grid.first + grid.spacing * np.array(probe), (100, 1))
        light = gsgi.sample(bake, position, normal)
        assert light.min() > 0.1
        np.testing.assert_allclose(basis @ grid.sh[probe], light, rtol=1e-4)


def test_one_probe_is_in_the_middle():
    grid = probe_grid(bake_of_degree_2(), 100.0)
    assert grid.sh.shape[:3] == (1, 1, 1)
    np.testing.assert_allclose(grid.first, [0, 0, 1.5])


def test_both_formats_hold_the_same():
    grid = probe_grid(bake_of_degree_2(), 1.0)
    arrays, text = np.load(io.BytesIO(encode(grid, "a.npz"))), json.loads(encode(grid, "a.json"))
    np.testing.assert_array_equal(arrays["sh"], grid.sh)
    assert text["size"] == list(grid.sh.shape[:3])
    assert str(arrays["convention"]) == text["convention"]
    for name in ("first", "spacing"):
        np.testing.assert_allclose(text[name], arrays[name])
    np.testing.assert_allclose(np.reshape(text["sh"], grid.sh.shape), grid.sh, rtol=1e-5)
    assert encode(grid, "a.npz") == encode(grid, "b.npz")


def test_too_many_and_none_are_refused():
    with pytest.raises(UsageError, match=f"more than {PROBES_MAX}: take a larger spacing"):
        probe_grid(bake_of_degree_2(), 1e-3)
    with pytest.raises(UsageError, match="no Gaussians"):
        probe_grid(Bake(nothing(), SurfaceBlend(), coarse=nothing()), 1.0)


def test_the_command_writes_a_file_and_names_what_is_wrong(tmp_path, capfd):
    bake, out = tmp_path / "room.gsgi", tmp_path / "room.npz"
    bake.write_bytes(codec.encode(bake_of_degree_2()))
    assert run(["export", str(bake), "-o", str(out), "--probes", "1", "-q"]) == 0
    assert capfd.readouterr().err == f"wrote {out}: 2 x 1 x 3 probes, {out.stat().st_size} bytes\n"
    assert np.load(out)["sh"].shape == (2, 1, 3, 9, 3)
    assert run(["export", str(bake), "-o", str(tmp_path / "room.txt"), "--probes", "1"]) == 1
    assert "room.txt: probes are written as .npz or .json" in capfd.readouterr().err
    assert run(["export", str(tmp_path / "none.gsgi"), "-o", str(out), "--probes", "1"]) == 2
