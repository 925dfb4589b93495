"""Screenshot tests: check that a scene still looks the same. Copy this file into your tests and point SCENE at yours.

    pip install '.[test]'    # in a copy of gsgi
    pytest --gsgi-update 05_screenshot_test.py    # draw the golden images; look at them and commit them
    pytest 05_screenshot_test.py                  # compare; a failure says by how much and writes gsgi-report/

The golden images are beside this file, in screenshots/05_screenshot_test/. On one driver or driver family,
name@llvmpipe-22.3.png or name@nvidia.png replaces name.png; `pytest --gsgi-update-for driver` writes it. The tests need
no window and no GPU. Without OpenGL they are skipped; with --gsgi-backend egl they fail instead.
"""

from pathlib import Path

import pytest

SCENE = Path(__file__).parent / "scenes" / "cornell.glb"


@pytest.mark.parametrize("camera", ["front", "corner"])
def test_the_room_looks_as_it_did(gsgi_render, assert_screenshot, camera):
    frame = gsgi_render(SCENE, camera, size=(160, 120), exposure=2.0)  # (120, 160, 3) uint8; bake="room.gsgi" adds GI
    assert_screenshot(frame, f"cornell-{camera}", max_ratio=0.005)  # drivers differ at the edges of shadows


def test_the_room_has_its_shape(gsgi_render, assert_screenshot):
    depth = gsgi_render(SCENE, "front", size=(48, 36), layer="depth")  # (36, 48) float32, m: an .exr
    assert_screenshot(depth, "cornell-depth", max_difference=1e-4)
