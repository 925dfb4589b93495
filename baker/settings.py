"""What a bake may cost: the defaults of the command line and of the Python call."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """What a bake may cost. `size` is the edge of a fitted view (px), `samples` its paths per pixel."""

    gaussians: int = 4096
    views: int = 64
    size: int = 192
    samples: int = 32
    iterations: int = 1500
    denoise: bool = True
    seed: int = 0
