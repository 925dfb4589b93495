"""What a bake may cost: the defaults of the command line and of the Python call."""

from dataclasses import dataclass

# What a bake can leave out, by the name that the command line has for it.
EFFECTS = ("punctual", "emissive", "environment", "alpha-mask", "double-sided", "normal-map", "unlit")


@dataclass(frozen=True)
class Settings:
    """What a bake may cost. None leaves a number to the plan.

    size: edge of a fitted view, px. samples: most paths per pixel; fewer are taken where the standard error of B is
    below `error` * (B + its mean) before. bounces: surfaces that a path may visit after the point; None: so many that
    further ones add less than `bounce_fraction` of the picture. ignore: effects (of EFFECTS) that the
    bake leaves out.
    """

    gaussians: int = 4096
    views: int | None = None
    size: int | None = None
    samples: int = 256
    error: float = 0.1
    bounces: int | None = None
    bounce_fraction: float = 0.005
    iterations: int | None = None
    denoise: bool = True
    ignore: tuple[str, ...] = ()
    seed: int = 0
