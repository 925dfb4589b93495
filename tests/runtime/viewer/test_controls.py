"""What the viewer's keys do."""

import pytest

from gsgi.runtime.viewer.controls import EXPOSURE_STEP, HELP, KEYS, Controls


def test_keys_choose_the_view():
    controls = Controls()
    for key, view in (("2", "primary"), ("3", "indirect"), ("4", "ellipsoids"), ("1", "final")):
        assert controls.press(key) == ""
        assert controls.view == view


def test_without_baked_light_there_is_none_to_show():
    controls = Controls(baked=False, scalable=False)
    for key in "34":
        assert "--gi" in controls.press(key)
        assert controls.view == "final"
    assert "surface" in controls.press("R")
    assert controls.splat_scale == 1


def test_exposure_goes_up_and_back_and_is_taken_anew():
    controls = Controls(exposure=2.0)
    for _ in range(3):
        controls.press("UP")
    assert controls.exposure == pytest.approx(4.0)
    controls.press("DOWN")
    assert controls.exposure == pytest.approx(4.0 / EXPOSURE_STEP)
    controls.press("M")
    assert controls.exposure == 0


def test_resolution_goes_round():
    controls = Controls()
    assert [(controls.press("R"), controls.splat_scale)[1] for _ in range(4)] == [2, 3, 4, 1]


def test_switches():
    controls = Controls()
    controls.press("C")
    controls.press("P")
    assert controls.costs
    assert controls.picture_wanted
    controls.press("F")
    assert controls.flags_wanted
    assert controls.press("H") == HELP
    assert controls.press("H") == ""
    controls.press("C")
    assert not controls.costs
    assert not controls.closing
    controls.press("ESCAPE")
    assert controls.closing


def test_held_keys_add_up():
    controls = Controls()
    assert controls.direction == (0, 0, 0)
    for key in "WDE":
        controls.press(key)
    assert controls.direction == (1, 1, -1)
    controls.press("A")
    assert controls.direction == (0, 1, -1)
    assert not controls.fast
    controls.press("RIGHT_SHIFT")
    assert controls.fast
    for key in (*"WADE", "RIGHT_SHIFT", "S"):  # one that was never pressed, too
        controls.release(key)
    assert controls.direction == (0, 0, 0)
    assert not controls.fast


def test_other_keys_do_nothing():
    controls = Controls()
    assert controls.press("F1") == ""
    assert controls == Controls()


def test_help_names_every_key():
    names = {word for line in HELP.splitlines() for word in line[:14].split()}
    spelled = {"UP": "Up", "DOWN": "Down", "LEFT_SHIFT": "Shift", "RIGHT_SHIFT": "Shift", "ESCAPE": "Esc"}
    assert {spelled.get(key, key) for key in KEYS} == names - {"mouse,", "drag"}


def test_digits_switch_light_groups():
    controls = Controls(groups=("base", "lamps"))
    assert controls.press("6") == "light group lamps: off"
    assert controls.off == {"lamps"}
    assert controls.press("5") == "light group base: off"
    assert controls.press("6") == "light group lamps: on"
    assert controls.off == {"base"}
    assert controls.press("7") == "no light group 3: the bake has 2"
    assert Controls().press("5") == "no light group 1: the bake has 0"
