"""What the benchmarks about blend operators compute, apart from the bakes that they measure."""

from types import SimpleNamespace

import numpy as np
import pytest
from benches import operator_motion
from benches.operator_bakes import budgets, cold_seconds
from benches.operator_frames import Frame
from benches.operator_sphere import relative_error, way
from benches.operators import gaussians_at, smallest
from benches.probes import Probes, grid_size

from gsgi.baker.native import kernels
from gsgi.runtime.camera import look_at
from gsgi.runtime.vectors import sphere

BAKES = [SimpleNamespace(gaussians=n, ssim=ssim) for n, ssim in ((100, 0.90), (200, 0.94), (400, 0.93), (800, 0.96))]


def test_budgets_double_from_a_share_of_draft_to_most():
    assert list(budgets(10_000, 1024)) == [128, 256, 512, 1024]
    assert list(budgets(10, 4)) == [32]


def test_seconds_of_tracing_count_what_earlier_bakes_left_in_the_cache():
    def report(paths, seconds):
        return {
            "paths": paths,
            "stages": [{"stage": "fit", "seconds": 9.0}, {"stage": "irradiance", "seconds": seconds}],
        }

    first = {"report": report(10, 4.0), "trace_s": cold_seconds(report(10, 4.0), [], True)}
    more = {"report": report(20, 5.0), "trace_s": cold_seconds(report(20, 5.0), [first], True)}
    assert (first["trace_s"], more["trace_s"]) == (4.0, 9.0)
    assert cold_seconds(report(20, 0.1), [first, more], False) == 9.0
    assert cold_seconds(report(10, 0.1), [more, first], False) == 4.0


def test_the_smallest_bake_that_reaches_an_ssim():
    assert smallest(BAKES, 0.93).gaussians == 200
    assert smallest(BAKES, 0.99).gaussians == 800


def test_gaussians_between_bakes_are_linear_in_their_logarithm():
    assert gaussians_at(BAKES, 0.92) == pytest.approx(100 * 2**0.5)
    assert gaussians_at(BAKES, 0.94) == pytest.approx(200)
    assert gaussians_at(BAKES, 0.5) == 100
    assert gaussians_at(BAKES, 0.97) is None


@pytest.mark.parametrize("most", [1, 7, 100, 4321])
def test_a_grid_of_probes_is_near_cubic_and_uses_what_it_may(most):
    extent = np.array([4.0, 2.0, 1.0])
    size = np.array(grid_size(extent, most))
    assert size.prod() <= most < (size + 1).prod()
    if most >= 100:
        cell = extent / size
        assert cell.max() / cell.min() < 1.5


def test_probes_meet_a_linear_field_between_them():
    low, high = np.zeros(3), np.array([4.0, 2.0, 2.0])
    middle = np.stack(np.meshgrid([0.5, 1.5, 2.5, 3.5], [0.5, 1.5], [0.5, 1.5], indexing="ij"), axis=-1)
    sh = np.zeros((4, 2, 2, 9, 3), np.float16)
    sh[..., 0, :] = 1 + middle
    probes = Probes(low, high, sh)
    position, normal = np.array([[1.2, 0.7, 1.1], [3.4, 1.4, 0.6]]), sphere(2)
    constant = kernels.sh_basis(np.ascontiguousarray(normal), 0)
    assert probes.evaluate(position, normal) == pytest.approx(constant * (1 + position), abs=1e-6)  # exact in halves


def test_a_way_visits_each_place_once_and_takes_clear_legs_alone():
    position = np.array([[0.0, 0, 0], [10, 0, 0], [4, 0, 0], [9, 0, 0]])
    clear = np.ones((4, 4), bool)
    clear[0, 1] = clear[1, 0] = False
    assert way(clear, position, 3) == [0, 3, 2, 1]
    assert way(clear, position, 1) == [0, 3]


def test_relative_error_counts_noise_in_the_mean_alone():
    rng = np.random.default_rng(0)
    truth = rng.uniform(1, 2, (1 << 16, 3))
    a, b = (truth + rng.normal(scale=0.1, size=truth.shape) for _ in range(2))
    error, rms = relative_error(truth, a, b)
    assert error == pytest.approx(0.1 / 2**0.5 * (2 / np.pi) ** 0.5 / 1.5, rel=0.02)  # mean of |normal|
    assert rms < 0.01
    error, rms = relative_error(1.1 * truth, a, b)
    assert rms == pytest.approx(0.1 * np.sqrt(7 / 3) / 1.5, rel=0.02)  # of 0.1 truth, uniform in [1, 2]
    assert error > 0.1


def wall(camera, light) -> Frame:
    """A wall in the plane z = 0 that shows light(position) of its points."""
    depth = np.zeros((48, 64), np.float32)
    frame = Frame(camera, np.zeros((48, 64, 3), np.float32), np.zeros((48, 64, 3), np.float32), depth + 1)
    ray = operator_motion.positions(frame) - camera.position
    depth = (-camera.position[2] / ray[..., 2]).astype(np.float32)
    normal = np.broadcast_to(np.float32([0, 0, 1]), (48, 64, 3))
    frame = Frame(camera, frame.indirect, normal, depth)
    return Frame(camera, light(operator_motion.positions(frame)), normal, depth)


def test_light_that_stays_on_a_wall_does_not_change_and_light_that_moves_along_does():
    start = look_at(np.array([0.3, 0.2, 2.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.9, 0.01)
    before, after, *_ = operator_motion.slow_path(start, np.array([1.0, 0, 0]), 0.01)

    def still(position):
        return position @ np.diag([0.1, 0.2, 0.3])

    found = operator_motion.changes(wall(before, still), wall(after, still))
    assert len(found) > 50
    assert np.abs(found).max() < 1e-5  # linear: interpolation is exact, up to float32 depths
    moved = operator_motion.changes(wall(before, still), wall(after, lambda p: still(p) + 0.01))
    assert moved == pytest.approx(0.01, abs=1e-5)


def test_slow_cameras_move_and_turn_evenly():
    start = look_at(np.array([0.0, 1.0, 2.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.9, 0.01)
    cameras = operator_motion.slow_path(start, np.array([0, 0, 1.0]), 0.02)
    assert len(cameras) == operator_motion.STEPS + 1
    moved = cameras[-1].position - start.position
    assert moved == pytest.approx([0, 0, 0.02 * operator_motion.STEPS])
    ahead = [camera.world_from_view[:3, 2] for camera in cameras]
    angle = np.arccos(ahead[0] @ ahead[-1])
    assert angle == pytest.approx(operator_motion.TURN * operator_motion.STEPS)
    assert cameras[-1].world_from_view[:3, 0] @ ahead[0] < 0  # to the left


def test_edges_and_creases_are_not_smooth():
    camera = look_at(np.array([0.0, 0.0, 2.0]), np.zeros(3), np.array([0.0, 1.0, 0.0]), 0.9, 0.01)
    depth, normal = np.ones((8, 20), np.float32), np.zeros((8, 20, 3), np.float32)
    depth[:, 5:] = 1.1  # an edge between columns 4 and 5
    depth[:, 15:] = 0  # nothing
    normal[:, :10] = 0, 0, 1  # a crease between columns 9 and 10
    normal[:, 10:] = 0, 1, 0
    smooth = Frame(camera, np.zeros_like(normal), normal, depth).smooth
    assert not smooth[[0, -1]].any()
    assert np.flatnonzero(smooth[3]).tolist() == [1, 2, 3, 6, 7, 8, 11, 12, 13]
