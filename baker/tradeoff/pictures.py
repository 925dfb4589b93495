"""B in the views as PNG images that the page decodes: references, and each method's difference from them."""

import base64
import io

import numpy as np

from gsgi.baker.evaluation.held_out import exposure
from gsgi.baker.trace.reference import Reference
from gsgi.runtime.display import tone_map

from .study import Entry, Study

# An exposed difference d from the reference is stored as HALF + HALF sign(d) sqrt(|d| / RANGE): finely where it is
# small. Twelve bits are enough, and compress better than sixteen.
RANGE, HALF = 8.0, 2047


def pictures(study: Study) -> dict:
    """What report.html shows: each view's name, exposure and reference, and one image per entry, as data URLs."""
    references = study.ground.references
    tone_scale = study.ground.tone_scale
    exposures = {name: exposure(reference.indirect, tone_scale) for name, reference in references.items()}
    views = [
        {"name": name, "exposure": exposures[name], "image": _url(_reference(reference, exposures[name]))}
        for name, reference in references.items()
    ]
    shown = [(reference, exposures[name]) for name, reference in references.items()]
    edge = next(iter(references.values())).valid.shape[0]
    return {
        "edge": edge,
        "range": RANGE,
        "half": HALF,
        "views": views,
        "entries": [_url(_entry(e, shown)) for e in study.entries],
    }


def _reference(reference: Reference, exposed: float) -> np.ndarray:
    """(H, 2 W, 3) uint8: the high and the low byte of 65535 sqrt(x / (1 + x)) for exposed B x."""
    light = np.maximum(_seen(reference.clean, reference), 0) * exposed
    value = np.round(65535 * np.sqrt(light / (1 + light))).astype(np.uint16)
    return np.concatenate([value >> 8, value & 255], axis=1).astype(np.uint8)


def _entry(entry: Entry, shown: list[tuple[Reference, float]]) -> np.ndarray:
    """(V H, 3 W, 3) uint8: for each view the difference's high eight bits and low four bits, and FLIP as grey."""
    rows = []
    for image, (reference, exposed) in zip(entry.images, shown, strict=True):
        difference = (_seen(image, reference) - _seen(reference.clean, reference)) * exposed
        coded = HALF + HALF * np.sign(difference) * np.sqrt(np.minimum(np.abs(difference) / RANGE, 1))
        value = np.round(coded).astype(np.uint16)
        flip = np.repeat(np.round(255 * _flip(image, reference, exposed))[..., None], 3, axis=2)
        rows.append(np.concatenate([value >> 4, value & 15, flip], axis=1).astype(np.uint8))
    return np.concatenate(rows)


def _flip(image: np.ndarray, reference: Reference, exposed: float) -> np.ndarray:
    """FLIP error (H, W) in [0, 1] of B, as `evaluation.metrics.flip` averages it."""
    import flip_evaluator

    pair = (tone_map(_seen(b, reference), exposed) for b in (reference.clean, image))
    errors, _, _ = flip_evaluator.evaluate(*map(np.ascontiguousarray, pair), "LDR", applyMagma=False)
    return np.where(reference.valid, np.asarray(errors).reshape(reference.valid.shape), 0)


def _seen(image: np.ndarray, reference: Reference) -> np.ndarray:
    return np.where(reference.valid[..., None], image, 0)


def _url(pixels: np.ndarray) -> str:
    from PIL import Image

    out = io.BytesIO()
    Image.fromarray(pixels).save(out, "PNG")
    return "data:image/png;base64," + base64.b64encode(out.getvalue()).decode()
