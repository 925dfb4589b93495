"""What a bake is asked for, before anything is decided."""

from dataclasses import dataclass, field
from functools import cached_property

from gsgi.baker.cache.code_version import code_version
from gsgi.baker.cache.digest import digest, scene_digest
from gsgi.baker.cache.store import Cache
from gsgi.baker.plan import Plan, make_plan
from gsgi.baker.progress import Progress
from gsgi.baker.settings import Settings
from gsgi.baker.trace.device import device
from gsgi.runtime.camera import Camera
from gsgi.runtime.errors import SceneError
from gsgi.runtime.scene import Scene

# Packages whose versions decide what a task gives; "open3d-cpu" is the name of Open3D's wheel without CUDA.
PACKAGES = ("drjit", "gsplat", "mitsuba", "mitsuba-oidn", "numpy", "open3d", "open3d-cpu", "scipy", "torch")


@dataclass(frozen=True)
class Request:
    """The scene under its light, the settings as they were given, further cameras to fit, and the name of the scene.

    With `evaluate`, the bake will be compared with references; with `seconds`, it is to end so long after it began.
    """

    scene: Scene
    settings: Settings
    path: dict[str, Camera] = field(default_factory=dict)
    name: str = "scene"
    evaluate: bool = True
    seconds: float | None = None

    def plan(self, progress: Progress, cache: Cache) -> Plan:
        """Make the plan, as `make_plan` does. Raises its errors; a SceneError names the scene."""
        try:
            return make_plan(self.scene, self.settings, progress, cache, self.path)
        except SceneError as error:
            raise SceneError(f"{self.name}: {error}") from error

    @cached_property
    def digest(self) -> str:
        """Digest of all that the tasks and their results depend on, the code and the device among it."""
        asked = self.scene.cameras, self.scene.groups, self.settings, self.path, self.evaluate
        return digest({"code": code(), "device": device(), "scene": scene_digest(self.scene), "asked": asked})


def code() -> str:
    """Version of the code that all tasks run, with that of the packages it calls."""
    versions = (code_version(module, PACKAGES) for module in ("gsgi.baker.tasks.task_list", "gsgi.baker.world.work"))
    return "".join(versions)
