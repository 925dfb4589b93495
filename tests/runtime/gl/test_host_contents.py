"""IndirectLight.check(): what it finds in textures that draw() takes."""

import itertools

import numpy as np
import pytest
from host import CAMERA, SIZE, Host, bake, octahedral, projection, projection_for, texture

from gsgi.runtime.gaussians import Bake, OverBlend
from gsgi.runtime.gl.host_textures import DEPTHS, NORMALS, OURS, SPACES, Encoding
from gsgi.runtime.gl.indirect_light import IndirectLight

POSE = CAMERA.view_from_world
QUARTER_TURN = np.array([[0.0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]])


@pytest.fixture
def host(gl):
    return Host(gl)


@pytest.fixture
def check(gl):
    """Findings of a light that reads its textures as `encoding` says."""

    def found(textures, encoding=OURS, pose=POSE, splat_scale=2, given=None, box=None, **how) -> list[str]:
        light = IndirectLight(gl, given or bake(), encoding, splat_scale, box)
        result = light.check(*textures, pose, projection_for(encoding, how.get("viewport")), **how)
        light.release()
        return result

    return found


@pytest.mark.parametrize("splat_scale", [1, 3])
def test_nothing_is_found_in_what_is_right(gl, host, check, splat_scale):
    for encoding in itertools.starmap(Encoding, itertools.product(DEPTHS, NORMALS, SPACES)):
        assert not check(host.textures(gl, encoding), encoding, splat_scale=splat_scale)


def test_nothing_is_found_in_parts_boxes_and_the_other_operator(gl, host, check):
    textures, white = host.textures(gl, OURS), texture(gl, np.ones((SIZE[1], SIZE[0], 4)))
    assert not check(textures, viewport=(16, 8, 48, 40), albedo=white)
    assert not check(textures, box=(np.array([-9.0, -9, -9]), np.array([0.0, 9, 9])))
    assert not check(textures, given=Bake(bake().gaussians, OverBlend(near=0.05)))


# Encodings: what the light is told, and what the textures hold; the start of the finding.
MISREAD = [
    (("linear", "signed"), ("linear", "unsigned"), 'normal: as Encoding.normal "signed" it is 0.7'),
    (("linear", "unsigned"), ("linear", "signed"), 'normal: as Encoding.normal "unsigned" it is '),
    (("linear", "octahedral"), ("linear", "signed"), "normal: in .* outside -1 ... 1"),
    (("window", "signed"), ("linear", "signed"), "depth: no pixel shows a surface"),
    (("linear", "signed"), ("window", "signed"), "bake: in 100.0%"),
]


@pytest.mark.parametrize(("told", "held", "finding"), MISREAD)
def test_textures_that_are_misread_are_found(gl, host, check, told, held, finding):
    _assert_found(check(host.textures(gl, Encoding(*held)), Encoding(*told)), finding)


def test_depth_that_is_no_frame_of_the_scene_is_found(gl, host, check):
    _, normal = host.textures(gl, OURS)
    broken = host.depth.copy()
    broken[3:9] = np.nan
    for depth, finding in (
        (1000 * host.depth, "depth: in 100.0% of the pixels it lies outside the planes of clip_from_view"),
        (0 * host.depth, "depth: no pixel"),
        (-host.depth, "depth: in 100.0% of the pixels it lies outside"),
        (broken, "depth: in .* it is not finite"),
    ):
        _assert_found(check((texture(gl, depth), normal)), finding)


def test_normals_that_do_not_fit_are_found(gl, host, check):
    depth, _ = host.textures(gl, OURS)
    zero = np.zeros((SIZE[1], SIZE[0], 4))
    _assert_found(check((depth, texture(gl, zero)), Encoding("linear", "signed")), "normal: in 100.0% .* is empty")
    behind = np.concatenate([octahedral(-host.normal), zero[..., :2]], axis=-1)
    _assert_found(check((depth, texture(gl, behind))), "normal: in 100.0% .* away from the camera")


def test_matrices_of_another_frame_are_found(gl, host, check):
    textures, elsewhere = host.textures(gl, OURS), POSE.copy()
    elsewhere[:3, 3] += 8
    _assert_found(check(textures, pose=POSE @ QUARTER_TURN), "normal: its cosine with the slopes of depth is 0.0")
    _assert_found(check(textures, pose=elsewhere), "bake: in 100.0% of the pixels it has no Gaussian")


def test_an_albedo_in_bytes_is_found(gl, host, check):
    albedo = texture(gl, np.full((SIZE[1], SIZE[0], 4), 255.0))
    _assert_found(check(host.textures(gl, OURS), albedo=albedo), "albedo: in 100.0% .* between 0 and 1")


def test_what_draw_refuses_is_refused(gl, host):
    light = IndirectLight(gl, bake(), Encoding("window"))
    with pytest.raises(ValueError, match="clip_from_view"):
        light.check(*host.textures(gl, light.encoding), POSE, projection("reversed"))
    light.release()


def _assert_found(findings: list[str], expected: str) -> None:
    start, *rest = expected.split(".*")
    assert any(finding.startswith(start) and all(part.strip() in finding for part in rest) for finding in findings), (
        findings
    )
