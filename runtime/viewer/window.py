"""The viewer's window: passes events to controls and camera, and draws frames until it is closed."""

import time
from collections.abc import Callable

from gsgi.runtime.camera import Camera
from gsgi.runtime.display import auto_exposure, to_uint8, tone_map
from gsgi.runtime.errors import FileError, GsgiError, UnsupportedError
from gsgi.runtime.gaussians import Bake
from gsgi.runtime.gl.profile import PassCost, Profile
from gsgi.runtime.light_groups import group_names
from gsgi.runtime.scene import Scene
from gsgi.runtime.world.world import World

from .controls import HELP, KEYS, Controls
from .cost_table import cost_table
from .fly_camera import FlyCamera
from .overlay import Overlay
from .picture import Picture
from .snapshot import write_snapshot

COSTS_EVERY = 0.5  # s between updates of the figures
LONGEST_STEP = 0.25  # s; a frame that took longer moves the camera no further
_KEY_NAMES = {digit: f"NUMBER_{digit}" for digit in "123456789"}  # in moderngl-window


class Viewer:
    """A window of `size` (width, height) px on `scene` with the light of `bake`, first seen through `camera`.

    `name` is that of the scene, for the title and the names of pictures. `say` receives lines for the user. With
    `exposure` None, the log-average of the first picture becomes mid-grey. Raises UnsupportedError without
    moderngl-window, a display or OpenGL 3.3. The sectors of a `World` follow the camera.
    """

    def __init__(
        self, scene: Scene, bake: Bake | World | None, camera: Camera, size: tuple[int, int], name: str,
        say: Callable[[str], None], exposure: float | None = None,
    ):  # fmt: skip
        self.window = _open(size)
        self._say, self._name = say, name
        self.fly = FlyCamera(camera, scene.diagonal())
        self.picture = Picture(self.window.ctx, scene, bake, self.window.buffer_size)
        self.overlay = Overlay(self.window.ctx)
        groups = group_names(bake) if bake else ()
        self._world = bake if isinstance(bake, World) else None
        if self._world:
            self._world.settle(camera.position)
        whole, exposed = self._world is None, exposure or 0.0
        self.controls = Controls(bake is not None, self.picture.scalable, whole, groups, exposure=exposed)
        self._keys = {getattr(self.window.keys, _KEY_NAMES.get(key, key)): key for key in KEYS}
        self._costs: list[tuple[PassCost, ...]] | None = None
        self._table, self._shown = "", 0.0  # of costs, and the time (s) at which it was made
        self.window.key_event_func = self._key
        self.window._window.push_handlers(on_deactivate=self.controls.held.clear)  # without focus no keys are held
        self.window.mouse_drag_event_func = lambda x, y, dx, dy: self.fly.turn(dx, dy)

    def run(self) -> None:
        """Draw until the window is closed, then release everything."""
        last = time.perf_counter()
        while not (self.window.is_closing or self.controls.closing):
            now = time.perf_counter()
            passed, last = min(now - last, LONGEST_STEP), now
            self.fly.move(self.controls.direction, passed, self.controls.fast)
            self._follow(passed)
            self.frame()
            self.window.swap_buffers()  # handles events too
        self._say(self.fly.flags())
        self.release()

    def frame(self) -> None:
        """Draw one frame into the window, and write it to a file if requested."""
        controls, picture, window = self.controls, self.picture, self.window
        if picture.size != window.buffer_size and min(window.buffer_size) > 0:
            picture.resize(window.buffer_size)
        picture.set_splat_scale(controls.splat_scale)
        picture.switch_off(controls.off)
        profile = Profile(window.ctx) if controls.costs else None
        picture.render(self.fly.camera, controls.view, profile)
        if not controls.exposure:
            controls.exposure = auto_exposure(picture.read())
        picture.show(window.fbo, controls.exposure)
        if controls.picture_wanted:
            controls.picture_wanted = False
            self._write_picture()
        if controls.flags_wanted:
            controls.flags_wanted = False
            self._say(self.fly.flags())
        self._write_overlay(profile)
        self.overlay.draw(window.fbo, picture.size)
        self._write_title()

    def _follow(self, seconds: float) -> None:
        """Let the sectors of a world follow the camera."""
        if self._world:
            try:
                self._world.update(self.fly.camera.position, seconds)
            except GsgiError as error:
                self._say(str(error))

    def release(self) -> None:
        """Free the GPU memory and close the window."""
        if self._world:
            self._world.close()
        self.picture.release()
        self.overlay.release()
        self.window.close()

    def _key(self, symbol: int, action: str, _) -> None:
        key = self._keys.get(symbol)
        if key and action == self.window.keys.ACTION_RELEASE:
            self.controls.release(key)
        elif key and (line := self.controls.press(key)):
            self._say(line)

    def _write_picture(self) -> None:
        """Write the picture as `gsgi render` does, without overlay and without the driver's rounding."""
        try:
            path = write_snapshot(self._name, to_uint8(tone_map(self.picture.read(), self.controls.exposure)))
        except FileError as error:
            self._say(str(error))
        else:
            self._say(f"wrote {path}")

    def _write_overlay(self, profile: Profile | None) -> None:
        self._update_costs(profile)
        parts = self._status(), self._table, HELP if self.controls.help else ""
        self.overlay.write("\n\n".join(part for part in parts if part))

    def _update_costs(self, profile: Profile | None) -> None:
        """Make the table of costs anew every COSTS_EVERY."""
        if profile is None:
            self._costs, self._table = None, ""
            return
        if self._costs is None:  # skip the first frame: the timers of some drivers start with nonsense
            self._costs = []
            return
        if self._costs and [cost.name for cost in self._costs[-1]] != [cost.name for cost in profile.passes]:
            self._costs = []
        self._costs.append(profile.passes)
        now = time.perf_counter()
        if len(self._costs) == 1 or now - self._shown >= COSTS_EVERY:
            self._table = cost_table(self._costs)
            self._costs, self._shown = self._costs[-1:], now

    def _status(self) -> str:
        """What is shown, as one line."""
        controls = self.controls
        scale = f", Gaussians at 1/{controls.splat_scale} resolution" if controls.splat_scale > 1 else ""
        return f"{controls.view}, exposure {controls.exposure:.3g}{scale}"

    def _write_title(self) -> None:
        title = f"{self._name}: {self._status()} (H: help)"
        if self.window.title != title:
            self.window.title = title


def _open(size: tuple[int, int]):
    """Open a moderngl-window of pyglet. Raises UnsupportedError with a reason."""
    try:
        from moderngl_window.context.pyglet.window import Window

        window = Window(title="gsgi view", size=size, gl_version=(3, 3), vsync=True)
    except ModuleNotFoundError as error:
        raise UnsupportedError(f"{error.name} is not installed: install gsgi with its extra 'view'") from None
    except Exception as error:  # pyglet and moderngl raise many types
        reason = " ".join(f"{type(error).__name__} {error}".split())
        raise UnsupportedError(f"no window ({reason}); without a display, `gsgi render` draws to a file") from None
    window.exit_key = None  # it would destroy the context before its resources are released
    window.fullscreen_key = None
    return window
