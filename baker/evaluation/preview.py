"""Pictures of a running fit: B of the held-out views above their references, each view at its own exposure."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from gsgi.baker.evaluation.held_out import draw
from gsgi.baker.trace.reference import Reference
from gsgi.runtime.camera import Camera
from gsgi.runtime.display import auto_exposure, to_uint8, tone_map
from gsgi.runtime.errors import FileError
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.image import write_image


def make_folder(folder: Path) -> None:
    """Make a folder for pictures. Raises FileError if that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"{folder}: cannot make the folder: {error.strerror}") from error


class Preview:
    """Writes `fit-<Gaussians>-<iteration>.png` to a folder: the fit in the upper row, path tracing in the lower row.

    The Gaussians are those of both levels.
    """

    def __init__(self, folder: Path, references: Mapping[str, Reference], cameras: Mapping[str, Camera]):
        """`folder` must exist. `cameras` holds the cameras of the references, by name."""
        self._folder = folder
        self._views = [(cameras[name], reference) for name, reference in references.items()]

    def draw(self, iteration: int, baked: Bake) -> None:
        """Write the picture of this iteration."""
        columns = []
        for camera, reference in self._views:
            image = draw(baked, camera, reference)
            pair = (np.where(reference.valid[..., None], b, 0) for b in (image, reference.clean))
            exposure = auto_exposure(reference.indirect)
            columns.append(np.concatenate([tone_map(b, exposure) for b in pair]))
        count = len(baked.gaussians) + len(baked.coarse or ())
        name = f"fit-{count:06d}-{iteration:06d}.png"
        write_image(str(self._folder / name), to_uint8(np.concatenate(columns, axis=1)))
