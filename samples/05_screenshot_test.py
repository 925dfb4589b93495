"""Screenshot tests: does the scene still look as it did? Copy this file into your tests, and point SCENE at yours.

    pip install 'gsgi[test]'
    pytest --gsgi-update 05_screenshot_test.py    # draw the golden images; look at them, commit them
    pytest 05_screenshot_test.py                  # compare; a failure says by how much, and writes gsgi-report/

The golden images lie beside this file, in screenshots/05_screenshot_test/. One named name@llvmpipe-22.3.png or
name@nvidia.png counts before name.png on that driver or family: `pytest --gsgi-update-for driver` writes it. No window
and no GPU is needed; where there is no OpenGL at all the tests are skipped (--gsgi-backend egl: they fail).
"""

from pathlib import Path

import pytest

SCENE = Path(__file__).parent / "scenes" / "cornell.glb"


@pytest.mark.parametrize("camera", ["front", "corner"])
def test_the_room_looks_as_it_did(gsgi_render, assert_screenshot, camera):
    frame = gsgi_render(SCENE, camera, size=(160, 120), exposure=2.0)  # (120, 160, 3) uint8; bake="room.gsgi" adds GI
    assert_screenshot(frame, f"cornell-{camera}", max_ratio=0.005)  # drivers disagree where shadows end


def test_the_room_has_its_shape(gsgi_render, assert_screenshot):
    depth = gsgi_render(SCENE, "front", size=(48, 36), layer="depth")  # (36, 48) float32, m: an .exr
    assert_screenshot(depth, "cornell-depth", max_difference=1e-4)
