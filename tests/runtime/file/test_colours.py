"""Light as logarithms."""

import numpy as np

from gsgi.runtime.file.colours import code_max, pack_light, unpack_light


def test_errors_are_relative_to_the_light():
    light = np.exp(np.random.default_rng(1).uniform(np.log(1e-4), np.log(1e3), (2000, 1))) * [1, 0.5, 2]
    for steps in (1, 12, 16, 48, 255):
        code = pack_light(light, steps)
        back = unpack_light(code, steps)
        assert np.abs(np.log2(back / light)).max() <= 0.5 / steps + 1e-6
        np.testing.assert_array_equal(pack_light(back, steps), code)


def test_black_stays_black_and_so_becomes_what_is_next_to_it():
    light = np.array([[0, 0, 0], [1, 0, 0], [1, 2.0**-9, 2.0**-11], [-1, 0.5, -0.1], [2.0**-40, 0, 0]])
    back = unpack_light(pack_light(light, 16), 16)
    np.testing.assert_array_equal(back, [[0, 0, 0], [1, 0, 0], [1, 2.0**-9, 0], [0, 0.5, 0], [0, 0, 0]])


def test_light_beyond_the_range_is_clamped():
    for steps in (1, 16, 255):
        code = pack_light(np.array([[1e30, 65504, 65536], [2.0**15, 2.0**14, 1]]), steps)
        assert code.max() == code_max(steps)
        np.testing.assert_allclose(unpack_light(code, steps)[0], 2 ** (16 - 1 / steps), rtol=1e-6)
        np.testing.assert_array_equal(unpack_light(code, steps)[1], [2.0**15, 2.0**14, 0])
