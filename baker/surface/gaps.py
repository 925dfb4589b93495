"""Samples in gaps that are narrower than samples lie apart, of which Gaussians would make spots."""

import numpy as np

from gsgi.baker.neighbours import Neighbours
from gsgi.baker.trace.local_light import brightness
from gsgi.baker.trace.point_order import by_side

from .samples import SurfaceSamples

NEAREST, ALIKE = 8, 1  # neighbours on the same side, of which at most so many are as dark
BRIGHTER = 2.0  # times as bright as a sample in a gap the others are
SURE = 3.0  # standard errors beyond which a difference is none of noise


def in_gaps(samples: SurfaceSamples) -> np.ndarray:
    """Which samples (S,) bool are far darker than nearly all that are nearest to them.

    They lie in gaps: beneath the edge of a sheet of paper, between books, behind a picture. In light that varies over
    a length that samples tell, such as in a shadow, several neighbours are as dark.
    """
    light, _ = brightness(samples.indirect_a, samples.indirect_b)
    around = samples.blocks.light(samples.indirect_a, samples.indirect_b)
    noise, asked = around.noise.astype(np.float64), light < around.level  # the others are no darker than their block
    dark = np.zeros(len(light), bool)
    for _, here in by_side(samples.normal):
        one = here[asked[here]]
        if not len(one):
            continue
        _, near = Neighbours(samples.position[here]).nearest(samples.position[one], 1 + NEAREST)
        near = here[near[:, 1:]]
        more, sure = light[near] - light[one, None], SURE * np.hypot(noise[near], noise[one, None])
        brighter = (light[near] > BRIGHTER * light[one, None]) & (more > sure)
        dark[one] = brighter.sum(axis=1) >= NEAREST - ALIKE
    return dark
