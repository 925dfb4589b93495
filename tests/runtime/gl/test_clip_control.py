"""Hosts that draw under a glClipControl of their own, or with projections that mirror the image."""

import numpy as np
import pytest
from host import (
    CAMERA,
    LOWER_LEFT,
    NEGATIVE_ONE_TO_ONE,
    UPPER_LEFT,
    ZERO_TO_ONE,
    Host,
    bake,
    call,
    drawn,
    pixels,
    projection,
    rasterised,
)

from gsgi.runtime.gaussians import Bake, OverBlend
from gsgi.runtime.gl.host_textures import Encoding
from gsgi.runtime.gl.indirect_light import IndirectLight

OVER = Bake(bake().gaussians, OverBlend(near=0.05))


@pytest.mark.parametrize("splat_scale", [1, 2])
@pytest.mark.parametrize("given", [bake(), OVER], ids=["surface", "over"])
@pytest.mark.parametrize(
    ("origin", "z", "kind"),
    [
        (LOWER_LEFT, ZERO_TO_ONE, "reversed"),
        (LOWER_LEFT, ZERO_TO_ONE, "reversed, far"),
        (LOWER_LEFT, ZERO_TO_ONE, "zero to one"),
        (LOWER_LEFT, NEGATIVE_ONE_TO_ONE, "window"),
        (UPPER_LEFT, NEGATIVE_ONE_TO_ONE, "window"),
        (UPPER_LEFT, ZERO_TO_ONE, "reversed"),
    ],
)
def test_a_host_draws_under_its_own_clip_control(fresh_gl, origin, z, kind, given, splat_scale):
    """Its depth buffer and normals are drawn under it, the upper left origin with the first row on top."""
    gl, backward = fresh_gl, kind.startswith("reversed")
    if "GL_ARB_clip_control" not in gl.extensions:
        pytest.skip("the driver has no glClipControl")
    plain = rasterised(gl, projection(), False)
    encoding = Encoding("window", "signed")
    light = IndirectLight(gl, given, encoding, splat_scale=splat_scale)
    expected = pixels(light.draw(*plain, CAMERA.view_from_world, projection()))
    light.release()

    call(gl, "ClipControl", origin, z)
    encoding = Encoding("reversed" if backward else "window", "signed")
    textures = rasterised(gl, projection(kind), backward)
    light = IndirectLight(gl, given, encoding, splat_scale=splat_scale)
    found = pixels(light.draw(*textures, CAMERA.view_from_world, projection(kind)))
    light.release()
    assert expected[..., :3].mean() > 0.1
    rows = found[::-1] if origin == UPPER_LEFT else found
    if splat_scale == 1 or origin == LOWER_LEFT:  # blocks begin at the first row
        # 24 bits of depth are 2e-5 m on the farthest wall; halves have 11 bits
        np.testing.assert_allclose(rows, expected, rtol=2e-3, atol=2e-3)
    else:
        assert np.abs(rows - expected).mean() < 0.01 * expected.mean()


def test_a_mirrored_projection_is_a_mirrored_image(gl):
    """As engines draw that share projections with Vulkan."""
    host, mirror = Host(gl), np.diag([1.0, -1, 1, 1])
    light = IndirectLight(gl, bake(), splat_scale=1)
    expected = drawn(light, gl, host)
    host.depth, host.normal = host.depth[::-1], host.normal[::-1]
    textures = host.textures(gl, light.encoding)
    found = pixels(light.draw(*textures, CAMERA.view_from_world, mirror @ projection()))[..., :3]
    np.testing.assert_allclose(found[::-1], expected, rtol=2e-3, atol=1e-4)
    light.release()
