"""The C library, built by CMake and called through ctypes."""

import ctypes
import shutil
import subprocess
from ctypes import c_char_p, c_double, c_float, c_int32, c_size_t, c_uint32, c_uint64, c_void_p
from pathlib import Path

import numpy as np
import pytest
from repository import ROOT

from gsgi.runtime.errors import FormatError
from gsgi.runtime.file import codec

SOURCE = ROOT / "runtime" / "c"
OK, INVALID_ARGUMENT, INVALID_FILE, OUT_OF_MEMORY, UNSUPPORTED, DRIVER_ERROR, NOTHING_CULLED, CONTEXT_LOST = range(8)
RESTORE, DEFAULTS = range(2)
# Numbers of gsgi.h for the words of gsgi.Encoding.
DEPTHS = {"window": 0, "zero to one": 1, "reversed": 2, "linear": 3}
NORMALS = {"signed": 0, "unsigned": 1, "octahedral": 2, "octahedral unsigned": 3}
SPACES = {"world": 0, "view": 1}
ALBEDOS = {"linear": 0, "srgb": 1}

ALLOCATE = ctypes.CFUNCTYPE(c_void_p, c_size_t, c_void_p)
RELEASE = ctypes.CFUNCTYPE(None, c_void_p, c_void_p)
LOG = ctypes.CFUNCTYPE(None, ctypes.c_int, c_char_p, c_void_p)
GET_INTEGER = ctypes.CFUNCTYPE(None, ctypes.c_uint, ctypes.POINTER(c_int32))
GET_PROC_ADDRESS = ctypes.CFUNCTYPE(c_void_p, c_char_p, c_void_p)


class Sized(ctypes.Structure):
    """A struct whose first member is its size."""

    def __init__(self, **values):
        super().__init__(struct_size=ctypes.sizeof(self), **values)


class Callbacks(ctypes.Structure):
    _fields_ = (("allocate", ALLOCATE), ("release", RELEASE), ("log", LOG), ("user", c_void_p))


class OpenOptions(Sized):
    _fields_ = (("struct_size", c_size_t), ("callbacks", Callbacks), ("sampling", c_int32), ("lists", c_int32))


class Info(Sized):
    _fields_ = (
        ("struct_size", c_size_t), ("blend", c_int32), ("effects", c_uint32), ("bounces", c_uint32),
        ("sharpness", c_uint32), ("scene", c_uint64), ("tone_scale", c_float), ("near_plane", c_float),
        ("dilation", c_float), ("alpha_min", c_float), ("alpha_max", c_float), ("cutoff", c_float),
        ("weight_floor", c_float), ("radius", c_float), ("gaussian_count", c_uint32 * 2), ("sh_degree", c_uint32 * 2),
        ("sloped", c_int32 * 2), ("bounds_low", c_double * 3), ("bounds_high", c_double * 3),
        ("bake_bytes", c_size_t), ("light_bytes", c_size_t), ("group_count", c_uint32),
        ("relief", c_int32),
    )  # fmt: skip


class Texels(Sized):
    _fields_ = (
        ("struct_size", c_size_t), ("shape", ctypes.POINTER(c_float)), ("sh", ctypes.POINTER(c_float)),
        ("slope", ctypes.POINTER(c_float)), ("shape_rows", c_uint32), ("sh_rows", c_uint32), ("slope_rows", c_uint32),
        ("origin", c_double * 3), ("relief", ctypes.POINTER(c_float)), ("relief_rows", c_uint32),
    )  # fmt: skip


class LookupInfo(Sized):
    _fields_ = (
        ("struct_size", c_size_t), ("source", c_char_p), ("gaussians", ctypes.POINTER(c_float)),
        ("cells", ctypes.POINTER(c_uint32)), ("lists", c_void_p), ("gaussian_rows", c_uint32), ("cell_rows", c_uint32),
        ("list_rows", c_uint32), ("list_bits", c_uint32), ("bytes", c_size_t),
    )  # fmt: skip


class ContextOptions(Sized):
    _fields_ = (
        ("struct_size", c_size_t), ("callbacks", Callbacks), ("get_proc_address", GET_PROC_ADDRESS),
        ("get_proc_address_user", c_void_p), ("state", c_int32),
    )  # fmt: skip


class LightOptions(Sized):
    _fields_ = (
        ("struct_size", c_size_t), ("depth", c_int32), ("normal", c_int32), ("normal_space", c_int32),
        ("albedo", c_int32), ("rows", c_int32), ("splat_scale", c_int32), ("box_low", c_float * 3),
        ("box_high", c_float * 3), ("depth_range", c_float * 2), ("relief", c_int32),
    )  # fmt: skip


class View(Sized):
    _fields_ = (
        ("struct_size", c_size_t), ("view_from_world", c_float * 16), ("clip_from_view", c_float * 16),
        ("viewport", c_int32 * 4),
    )  # fmt: skip


class Stats(Sized):
    _fields_ = (
        ("struct_size", c_size_t), ("drawn", c_uint32 * 2), ("gaussian_bytes", c_size_t), ("target_bytes", c_size_t),
    )  # fmt: skip


class WorldOptions(Sized):
    _fields_ = (("struct_size", c_size_t), ("callbacks", Callbacks), ("budget", c_uint64), ("fade", c_float))


class WorldInfo(Sized):
    _fields_ = (
        ("struct_size", c_size_t), ("sector_count", c_uint32), ("resident_count", c_uint32), ("scene", c_uint64),
        ("effects", c_uint32), ("changing", c_int32), ("margin", c_double), ("budget", c_uint64), ("memory", c_uint64),
    )  # fmt: skip


class Sector(Sized):
    _fields_ = (
        ("struct_size", c_size_t), ("file", c_char_p), ("bytes", c_uint64), ("memory", c_uint64), ("low", c_double * 3),
        ("high", c_double * 3), ("bake", c_void_p), ("weight", c_float),
    )  # fmt: skip


def need_compiler() -> None:
    """Skip the test where the library cannot be built."""
    for tool in ("cmake", "cc"):
        if shutil.which(tool) is None:
            pytest.skip(f"the C library needs {tool}")


def build(folder: Path, *options: str, source: Path = SOURCE, flags: str = "") -> Path:
    """Configure and build a CMake project in `folder`, with all warnings as errors; returns the folder."""
    need_compiler()
    generator = ["-G", "Ninja"] if shutil.which("ninja") else []
    warnings = f"-DCMAKE_C_FLAGS=-Wall -Wextra -Wpedantic -Werror {flags}"
    configure = ["cmake", "-S", source, "-B", folder, *generator, warnings]
    for command in ([*configure, *options], ["cmake", "--build", folder]):
        run = subprocess.run(command, capture_output=True, text=True)
        assert run.returncode == 0, run.stdout + run.stderr
    return folder


class Messages(list):
    """The lines that the library logs, and the callbacks that collect them."""

    def __init__(self):
        self._log = LOG(lambda severity, message, user: self.append(message.decode()))
        self.callbacks = Callbacks(log=self._log)


class Budget:
    """Callbacks that allocate `count` blocks and no more, and keep what is not released."""

    def __init__(self, count: int):
        self.left, self.blocks = count, {}
        self.callbacks = Callbacks(allocate=ALLOCATE(self._allocate), release=RELEASE(self._release))

    def _allocate(self, size, user):
        if not self.left:
            return None
        self.left -= 1
        block = ctypes.create_string_buffer(size)
        self.blocks[ctypes.addressof(block)] = block
        return ctypes.addressof(block)

    def _release(self, memory, user):
        del self.blocks[memory]


class Library:
    """The functions of the shared library."""

    def __init__(self, path: Path):
        self.functions = ctypes.CDLL(str(path))
        self.functions.gsgi_result_string.restype = self.functions.gsgi_bake_group_name.restype = c_char_p

    def open(self, data: bytes, options: OpenOptions | None = None) -> tuple[int, c_void_p]:
        bake = c_void_p()
        given = None if options is None else ctypes.byref(options)
        return self.functions.gsgi_bake_open(data, c_size_t(len(data)), given, ctypes.byref(bake)), bake

    def opened(self, data: bytes, sampling: bool = False, lists: bool = False) -> c_void_p:
        result, bake = self.open(data, OpenOptions(sampling=sampling, lists=lists))
        assert result == OK
        return bake

    def close(self, bake: c_void_p) -> None:
        self.functions.gsgi_bake_close(bake)

    def info(self, bake: c_void_p) -> Info:
        info = Info()
        assert self.functions.gsgi_bake_info(bake, ctypes.byref(info)) == OK
        return info

    def group_names(self, bake: c_void_p) -> list[str]:
        names = (self.functions.gsgi_bake_group_name(bake, c_uint32(i)) for i in range(self.info(bake).group_count))
        return [name.decode() for name in names]

    def weigh(self, bake: c_void_p, weights: dict | None) -> int:
        """Weights by name, each three numbers, of all groups; None: ones."""
        values = [value for name in self.group_names(bake) for value in weights[name]] if weights else None
        given = (c_float * len(values))(*values) if weights else None
        return self.functions.gsgi_bake_weigh(bake, c_uint32(len(values) // 3 if weights else 0), given)

    def texels(self, bake: c_void_p, level: int) -> dict[str, np.ndarray]:
        """Arrays (texels, 4) of a level by name, and `origin` (3,)."""
        found = Texels()
        assert self.functions.gsgi_bake_texels(bake, level, ctypes.byref(found)) == OK
        texels = {}
        for name in ("shape", "sh", "slope", "relief"):
            rows = getattr(found, f"{name}_rows")
            texels[name] = np.ctypeslib.as_array(getattr(found, name), (2048 * rows, 4)).copy() if rows else None
        return texels | {"origin": np.array(found.origin)}

    def sample(self, bake: c_void_p, position: np.ndarray, normal: np.ndarray, *mapped: np.ndarray) -> np.ndarray:
        """B (N, 3) float32 at points (N, 3) with normals (N, 3), and these as normal maps bend them."""
        function = self.functions.gsgi_bake_sample_mapped if mapped else self.functions.gsgi_bake_sample
        return sampled(function, bake, position, normal, *mapped)

    def sample_free(self, bake: c_void_p, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """The same of free space alone."""
        return sampled(self.functions.gsgi_bake_sample_free, bake, position, normal)


def sampled(function, handle: c_void_p, *arrays: np.ndarray) -> np.ndarray:
    """What a function that samples a bake or a world gives at points (N, 3) with normals (N, 3): (N, 3) float32."""
    arrays = [np.ascontiguousarray(array, np.float32) for array in arrays]
    light = np.empty_like(arrays[0])
    pointers = (array.ctypes.data_as(c_void_p) for array in (*arrays, light))
    assert function(handle, c_size_t(len(light)), *pointers) == OK
    return light


def refusals(library, data: bytes) -> tuple[str | None, str | None]:
    """What Python and what C say of the bytes; None if they take them."""
    messages = Messages()
    result, bake = library.open(data, OpenOptions(callbacks=messages.callbacks, sampling=1))
    assert result in (OK, INVALID_FILE)
    if result == OK:
        library.close(bake)
    assert len(messages) == (result == INVALID_FILE)
    try:
        codec.decode(data)
    except FormatError as error:
        return str(error), messages[0] if messages else None
    return None, messages[0] if messages else None


def check_refusals(library, data: bytes) -> bool:
    """The same refusal by both: the same byte, field and expectation. Returns whether there is one."""
    python, c = refusals(library, data)
    assert (python is None) == (c is None), (python, c)
    assert python is None or c.split(", got")[0] == python.split(", got")[0]
    return python is not None


class Lookup:
    """A gsgi_lookup of a file's bytes: its `result`, `info`, and the tables (rows * 2048, C) by the samplers' names."""

    def __init__(self, library: Library, data: bytes):
        self.functions, self.handle, bake = library.functions, c_void_p(), library.opened(data)
        self.result = self.functions.gsgi_lookup_open(bake, ctypes.byref(self.handle))
        library.close(bake)
        if self.result != OK:
            return
        self.read()

    def read(self) -> None:
        """Read `info` and `tables`."""
        self.info = LookupInfo()
        assert self.functions.gsgi_lookup_read(self.handle, ctypes.byref(self.info)) == OK
        lists = ctypes.POINTER(ctypes.c_uint16 if self.info.list_bits == 16 else c_uint32)
        sources = {
            "gsgi_gaussians": (self.info.gaussians, self.info.gaussian_rows, 4),
            "gsgi_cells": (self.info.cells, self.info.cell_rows, 1),
            "gsgi_lists": (ctypes.cast(self.info.lists, lists), self.info.list_rows, 1),
        }
        self.tables = {
            name: np.ctypeslib.as_array(pointer, (2048 * rows, width)).copy()
            for name, (pointer, rows, width) in sources.items()
        }

    def upload(self, context: "Context") -> dict[str, int]:
        """The names of the textures."""
        names = (c_uint32 * 3)()
        assert self.functions.gsgi_lookup_upload(context.handle, self.handle, names) == OK, context.messages
        return dict(zip(self.tables, names, strict=True))

    def recolour(self, bake: c_void_p) -> int:
        return self.functions.gsgi_lookup_recolour(self.handle, bake)

    def close(self) -> None:
        self.functions.gsgi_lookup_close(self.handle)


class World:
    """A gsgi_world of a manifest on disk: its `result`; the files are read in this thread."""

    def __init__(self, library: Library, path: Path, data: bytes | None = None, **options):
        self.library, self.functions, self.messages = library, library.functions, Messages()
        self.folder, self.handle = path.parent, c_void_p()
        data = path.read_bytes() if data is None else data
        given = WorldOptions(callbacks=self.messages.callbacks, **options)
        arguments = data, c_size_t(len(data)), ctypes.byref(given), ctypes.byref(self.handle)
        self.result = self.functions.gsgi_world_open(*arguments)

    @property
    def info(self) -> WorldInfo:
        info = WorldInfo()
        assert self.functions.gsgi_world_read_info(self.handle, ctypes.byref(info)) == OK
        return info

    def sector(self, number: int) -> Sector:
        sector = Sector()
        assert self.functions.gsgi_world_read_sector(self.handle, c_uint32(number), ctypes.byref(sector)) == OK
        return sector

    @property
    def weights(self) -> dict[int, float]:
        """Those of the sectors in memory, by number."""
        sectors = map(self.sector, range(self.info.sector_count))
        return {number: sector.weight for number, sector in enumerate(sectors) if sector.bake}

    def update(self, eye, seconds: float) -> int:
        """The sector that is asked for, or -1."""
        load = c_int32()
        arguments = (c_float * 3)(*eye), c_double(seconds), ctypes.byref(load)
        assert self.functions.gsgi_world_update(self.handle, *arguments) == OK
        return load.value

    def open(self, number: int, data: bytes | None = None) -> tuple[int, c_void_p]:
        """The result, and the bake of a sector's bytes: by default those of its file."""
        bake = c_void_p()
        data = (self.folder / self.sector(number).file.decode()).read_bytes() if data is None else data
        options = OpenOptions(callbacks=self.messages.callbacks, sampling=1)
        arguments = data, c_size_t(len(data)), ctypes.byref(options), ctypes.byref(bake)
        return self.functions.gsgi_world_open_sector(self.handle, c_uint32(number), *arguments), bake

    def add(self, number: int, bake: c_void_p | None) -> int:
        return self.functions.gsgi_world_add(self.handle, c_uint32(number), bake)

    def step(self, eye, seconds: float) -> int:
        """Update, and read what is asked for, which is returned."""
        if (number := self.update(eye, seconds)) >= 0:
            result, bake = self.open(number)
            assert result == OK, self.messages
            assert self.add(number, bake) == OK, self.messages
        return number

    def settle(self, eye) -> None:
        """Read at once what is wanted around an eye."""
        while self.step(eye, np.inf) >= 0:
            pass

    def sample(self, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """B (N, 3) float32 at points (N, 3) with normals (N, 3)."""
        return sampled(self.functions.gsgi_world_sample, self.handle, position, normal)

    def sample_free(self, position: np.ndarray, normal: np.ndarray) -> np.ndarray:
        """The same of free space alone."""
        return sampled(self.functions.gsgi_world_sample_free, self.handle, position, normal)

    def close(self) -> None:
        self.functions.gsgi_world_close(self.handle)


class Context:
    """A gsgi_context in a context of moderngl, which is current. With `oldest` it is told that this is OpenGL 3.3."""

    def __init__(self, library: Library, gl, state: int = RESTORE, oldest: bool = False):
        self.library, self.messages, self.handle = library, Messages(), c_void_p()
        load = gl.mglo._context.load_opengl_function
        get_integer = GET_INTEGER(load("glGetIntegerv"))
        oldest_numbers = {0x821B: 3, 0x821C: 3, 0x821D: 0}  # major, minor version, number of extensions

        def get(number, place):
            if number in oldest_numbers:
                place[0] = oldest_numbers[number]
            else:
                get_integer(number, place)

        self._get = GET_INTEGER(get)
        replaced = {b"glGetIntegerv": ctypes.cast(self._get, c_void_p).value} if oldest else {}
        self._load = GET_PROC_ADDRESS(lambda name, user: replaced.get(name) or load(name.decode()) or None)
        options = ContextOptions(callbacks=self.messages.callbacks, get_proc_address=self._load, state=state)
        result = library.functions.gsgi_context_create(ctypes.byref(options), ctypes.byref(self.handle))
        assert result == OK, self.messages

    def destroy(self) -> None:
        self.library.functions.gsgi_context_destroy(self.handle)


class Light:
    """A gsgi_light of a file's bytes or of a world; `encoding` is a gsgi.Encoding."""

    def __init__(
        self, context: Context, data: bytes | World, encoding, splat_scale: int = 0, box=None, top_down: bool = False,
        relief: bool = False, lists: bool = False,
    ):  # fmt: skip
        self.context, self.functions, self.handle = context, context.library.functions, c_void_p()
        options = LightOptions(
            depth=DEPTHS[encoding.depth], normal=NORMALS[encoding.normal], normal_space=SPACES[encoding.normal_space],
            albedo=ALBEDOS[encoding.albedo], rows=int(top_down), splat_scale=splat_scale,
            relief=relief,
        )  # fmt: skip
        options.depth_range[:] = encoding.depth_range
        if box is not None:
            options.box_low[:], options.box_high[:] = box
        made = ctypes.byref(options), ctypes.byref(self.handle)
        if isinstance(data, World):
            self.result = self.functions.gsgi_light_create_world(context.handle, data.handle, *made)
        else:
            bake = context.library.opened(data, lists=lists)
            self.result = self.functions.gsgi_light_create(context.handle, bake, *made)
            context.library.close(bake)

    def cull(self, view_from_world: np.ndarray, clip_from_view: np.ndarray, viewport) -> int:
        view = View(viewport=tuple(viewport))
        view.view_from_world[:] = np.float32(view_from_world).T.ravel()
        view.clip_from_view[:] = np.float32(clip_from_view).T.ravel()
        return self.functions.gsgi_light_cull(self.handle, ctypes.byref(view))

    def draw(self, depth: int, normal: int, mapped: int = 0) -> tuple[int, int]:
        """The result, and the name of the texture with B."""
        indirect, textures = c_uint32(), map(c_uint32, (depth, normal, *([mapped] if mapped else [])))
        draw = self.functions.gsgi_light_draw_mapped if mapped else self.functions.gsgi_light_draw
        return draw(self.handle, *textures, ctypes.byref(indirect)), indirect.value

    def recolour(self, bake: c_void_p) -> int:
        return self.functions.gsgi_light_recolour(self.handle, bake)

    def follow(self, world: World) -> int:
        return self.functions.gsgi_light_follow(self.handle, world.handle)

    def add(self, framebuffer: int, albedo: int) -> int:
        return self.functions.gsgi_light_add(self.handle, c_uint32(framebuffer), c_uint32(albedo))

    def stats(self) -> Stats:
        stats = Stats()
        assert self.functions.gsgi_light_stats(self.handle, ctypes.byref(stats)) == OK
        return stats

    def reset(self) -> int:
        return self.functions.gsgi_light_reset(self.handle)

    def destroy(self) -> None:
        self.functions.gsgi_light_destroy(self.handle)
