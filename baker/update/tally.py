"""How much of an earlier bake an update has kept."""

from dataclasses import dataclass, field

import numpy as np

# What becomes of a point: no path around it has met a change; light around has changed by less than is traced again,
# and what is known of it is shifted by that; its first paths are traced again, or all of them; it is new; its surface
# is gone from there.
SAME, SHIFTED, PART, AGAIN, NEW, GONE = FATES = range(6)


@dataclass
class Tally:
    """Numbers of points by their fate: those of known light, of samples, and of references."""

    _found: dict[tuple[str, str], np.ndarray] = field(default_factory=dict)

    def add(self, kind: str, name: str, fate: np.ndarray) -> None:
        """Count points of a `kind` by their fates (P,); those of one `name` count once."""
        self._found[kind, name] = np.bincount(fate, minlength=len(FATES))

    @property
    def points(self) -> dict[str, np.ndarray]:
        """The numbers of points by fate, by kind."""
        kinds = dict.fromkeys(kind for kind, _ in self._found)
        return {kind: sum(found for (of, _), found in self._found.items() if of == kind) for kind in kinds}

    def lines(self) -> list[str]:
        """One line for each kind of points."""
        return [_line(kind, found) for kind, found in self.points.items()]

    def as_dict(self) -> dict[str, dict[str, int]]:
        """The numbers by kind and fate."""
        names = "same", "shifted", "part", "again", "new", "gone"
        return {kind: dict(zip(names, map(int, found), strict=True)) for kind, found in self.points.items()}


def _line(kind: str, found: np.ndarray) -> str:
    total = max(int(found[:GONE].sum()), 1)
    same, shifted, part, again, new, _ = (f"{count / total:.1%}" for count in found)
    return (
        f"{kind}, {total} points: {same} met no change, {shifted} shifted by less than is seen, traced again {part} in "
        f"part and {again} as a whole, {new} new"
    )
