"""Key bindings of the viewer. No heavy imports, since the command line prints the table."""

from dataclasses import dataclass, field

VIEWS = {"1": "final", "2": "primary", "3": "indirect", "4": "ellipsoids"}
GROUPS = "56789"  # keys of the light groups, in the order of their names
SCALES = 1, 2, 3, 4  # frame pixels per point at which Gaussians are read, along each axis
EXPOSURE_STEP = 2 ** (1 / 3)  # a third of a stop

# Directions of the keys that are held down: right, up, back.
MOVES = {"A": (-1, 0, 0), "D": (1, 0, 0), "Q": (0, -1, 0), "E": (0, 1, 0), "W": (0, 0, -1), "S": (0, 0, 1)}
SHIFTS = "LEFT_SHIFT", "RIGHT_SHIFT"

HELP = """\
W A S D       fly: forward, left, back, right
Q E           down, up
Shift         faster
mouse, drag   look around
1 2 3 4       final image, primary light, indirect light B, Gaussians as ellipsoids
5 6 7 8 9     the first five light groups of the bake, base first, off and on
Up Down       exposure, a third of a stop
M             exposure that `gsgi render` takes for this picture
C             what each pass costs; waits for the GPU after each
R             read Gaussians at full, half, quarter resolution
P             write a .png, as `gsgi render` does, into the current folder
F             print the flags of `gsgi render` for this place; Esc prints them too
H             this list
Esc           quit"""


@dataclass
class Controls:
    """State that the keys change. `exposure` 0 means that the next picture determines it.

    `baked`: whether there is baked light to show; `whole`: whether all of it is in one file; `scalable`: whether it can
    be read at a lower resolution; `groups`: the names of its light groups, of which those in `off` are off.
    """

    baked: bool = True
    scalable: bool = True
    whole: bool = True
    groups: tuple[str, ...] = ()
    off: set[str] = field(default_factory=set)
    exposure: float = 0.0
    view: str = "final"
    splat_scale: int = 1
    costs: bool = False
    help: bool = False
    picture_wanted: bool = False
    flags_wanted: bool = False
    closing: bool = False
    held: set[str] = field(default_factory=set)

    def press(self, key: str) -> str:
        """Handle a key that goes down; return a line for the user, or "". Keys that are not in HELP do nothing."""
        if key in MOVES or key in SHIFTS:
            self.held.add(key)
        elif key in VIEWS:
            if not self.baked and VIEWS[key] in ("indirect", "ellipsoids"):
                return "no baked light to show: gsgi view SCENE --gi FILE"
            if not self.whole and VIEWS[key] == "ellipsoids":
                return "the Gaussians of a world are in many files: view one of them"
            self.view = VIEWS[key]
        elif key in GROUPS:
            return self._switch(GROUPS.index(key))
        elif key in ("UP", "DOWN"):
            self.exposure *= EXPOSURE_STEP if key == "UP" else 1 / EXPOSURE_STEP
        elif key == "M":
            self.exposure = 0.0
        elif key == "C":
            self.costs = not self.costs
        elif key == "R":
            if not self.scalable:
                return "only a bake of the surface operator is read at a lower resolution"
            self.splat_scale = SCALES[(SCALES.index(self.splat_scale) + 1) % len(SCALES)]
        elif key == "P":
            self.picture_wanted = True
        elif key == "F":
            self.flags_wanted = True
        elif key == "H":
            self.help = not self.help
            return HELP if self.help else ""
        elif key == "ESCAPE":
            self.closing = True
        return ""

    def release(self, key: str) -> None:
        """Handle a key that goes up."""
        self.held.discard(key)

    def _switch(self, index: int) -> str:
        """Switch a light group off or on; return what it is now."""
        if index >= len(self.groups):
            return f"no light group {index + 1}: the bake has {len(self.groups)}"
        self.off ^= {self.groups[index]}
        return f"light group {self.groups[index]}: {'off' if self.groups[index] in self.off else 'on'}"

    @property
    def direction(self) -> tuple[int, int, int]:
        """Direction of flight from the held keys: right, up, back, each -1, 0 or 1."""
        return tuple(sum(MOVES[key][axis] for key in self.held if key in MOVES) for axis in range(3))

    @property
    def fast(self) -> bool:
        """Whether Shift is held down."""
        return not self.held.isdisjoint(SHIFTS)


KEYS = (
    *MOVES,
    *SHIFTS,
    *VIEWS,
    *GROUPS,
    "UP",
    "DOWN",
    "M",
    "C",
    "R",
    "P",
    "F",
    "H",
    "ESCAPE",
)  # all keys that press() handles
