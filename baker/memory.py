"""Estimate the peak memory of a bake or a picture from the data that it holds, and find out how much there is."""

from contextlib import suppress
from pathlib import Path

from gsgi.runtime.errors import GsgiError
from gsgi.runtime.scene import Scene

# Bytes, from `./dev bench scenes`.
PROCESS = 1_000_000_000  # libraries and compiled kernels
PER_TRIANGLE = 700  # arrays, tables and the trees of two ray casters
PER_COPY = 200  # of a triangle in copies: positions, and the tree in which views are placed
PER_TEXEL = 12  # decoded textures and the path tracer's copy
PER_PIXEL = 80  # the images of a view: traced, denoised and as the target of the fit
PER_GAUSSIAN = 600  # with its gradients and moments

# Bytes per pixel of a picture: of a Cornell box at 1024 x 1024 to 4096 x 4096 pixels, of a church with blended windows
# at 768 x 768 and 1536 x 1536.
PER_DRAWN_PIXEL = 150  # the targets of a software renderer, and the layer that is written
PER_TRACED_PIXEL = 300  # of a reference: surfaces, and the sums of both halves
PER_BLENDED_PIXEL = 800  # of one with partly transparent surfaces


def peak_memory(scene: Scene, placed: int, pixels: int, gaussians: int) -> int:
    """Expected peak of a bake's resident memory, bytes.

    `placed` is the number of triangles in which its views are placed, copies too. `pixels` are those of all its views,
    or its surface samples.
    """
    shapes = {id(shape): shape for shape in (getattr(mesh, "shape", mesh) for mesh in scene.meshes)}
    triangles = sum(len(shape.triangle) for shape in shapes.values())
    texels = sum(texture.pixels.size // 4 for texture in scene.textures)
    held = PER_TRIANGLE * triangles + PER_COPY * max(placed - triangles, 0) + PER_TEXEL * texels
    return PROCESS + held + PER_PIXEL * pixels + PER_GAUSSIAN * gaussians


def check(what: str, needed: int) -> str:
    """How much memory `what` takes, as text. Raises GsgiError if less than `needed` (bytes) is available."""
    told, there = f"{what} takes about {_told(needed)} of memory", available()
    if there is not None and needed > there:
        raise GsgiError(f"{told}, and {_told(there)} are available")
    return told


def check_picture(size: tuple[int, int], per_pixel: int) -> str:
    """The same for a picture of `size` (width, height) px."""
    width, height = size
    return check(f"a picture of {width} x {height} px", per_pixel * width * height)


def available() -> int | None:
    """Memory that this process can still take, bytes; None where the system, as other than Linux, does not say."""
    limits = []
    with suppress(OSError, ValueError, StopIteration):
        lines = Path("/proc/meminfo").read_text().splitlines()
        limits.append(1024 * int(next(line.split()[1] for line in lines if line.startswith("MemAvailable:"))))
    with suppress(OSError, ValueError):  # of a container; "max" without a limit
        limits.append(int(Path("/sys/fs/cgroup/memory.max").read_text()))
    with suppress(ImportError, OSError, ValueError):  # ulimit -v
        import resource

        limit, _ = resource.getrlimit(resource.RLIMIT_AS)
        if limit != resource.RLIM_INFINITY:
            pages = int(Path("/proc/self/statm").read_text().split()[0])
            limits.append(max(limit - pages * resource.getpagesize(), 0))
    return min(limits, default=None)


def _told(size: int) -> str:
    return f"{size / 1e9:.1f} GB" if size >= 1e9 else f"{max(size / 1e6, 1):.0f} MB"
