"""Frames of Panda3D with baked light, drawn in a process of its own:

    panda3d_frames.py GI HALF_GI OVER_GI BUMPY_GI OUT [CONFIG]

GI and BUMPY_GI belong to the Cornell box; HALF_GI holds the same light everywhere. OUT gets the frames, (H, W, 3)
float32, row 0 on top, and the messages of errors, by name. CONFIG: lines for Panda3D, parted by semicolons.
"""

import sys
from math import atan, degrees, radians, tan

import gltf
import numpy as np
from direct.task.TaskManagerGlobal import taskMgr
from panda3d.core import (
    Camera,
    CardMaker,
    FrameBufferProperties,
    Geom,
    GeomEnums,
    GeomNode,
    GeomTristrips,
    GeomVertexArrayFormat,
    GeomVertexData,
    GeomVertexFormat,
    GraphicsEngine,
    GraphicsOutput,
    GraphicsPipe,
    GraphicsPipeSelection,
    Loader,
    LoaderOptions,
    Material,
    NodePath,
    OrthographicLens,
    Texture,
    TextureStage,
    TransparencyAttrib,
    WindowProperties,
    load_prc_file_data,
)
from repository import SAMPLES

from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.panda3d import BakedLight

SIZE, LARGER = (96, 80), (150, 60)
FOV_Y = 39.3076  # degrees, of the file's first camera
SCENE = SAMPLES / "scenes" / "cornell.glb"
WIDTH = 0.5  # m, of the view of the orthographic lens
BACK = 0.558  # m, from the origin to the square on the back wall
TEXEL = 60, 170, 210  # of the normal map
SCALES = "2", float("nan"), float("inf"), -1.0, None  # of light, that cannot be


def output(size: tuple[int, int], bits: int, first: GraphicsOutput | None = None) -> GraphicsOutput:
    """An image without a window: of 8 bits, or of float32 beside the `first`, which has the context."""
    properties = FrameBufferProperties()
    properties.set_rgba_bits(bits, bits, bits, bits)
    properties.float_color, properties.depth_bits = bits > 8, 24
    pipe = first.pipe if first else GraphicsPipeSelection.get_global_ptr().make_default_pipe()
    context = (first.gsg, first) if first else ()
    return GraphicsEngine.get_global_ptr().make_output(
        pipe, "host", 0, properties, WindowProperties.size(*size), GraphicsPipe.BF_refuse_window, *context
    )


class Host:
    """An engine that draws the Cornell box through its first camera, unlit."""

    def __init__(self, first: GraphicsOutput, bits: int = 32):
        self.frame = output(SIZE, bits, first)
        self.texture = Texture()
        self.frame.add_render_texture(self.texture, GraphicsOutput.RTM_copy_ram, GraphicsOutput.RTP_color)
        self.root, self.camera = NodePath("root"), NodePath(Camera("camera"))
        self.room = NodePath(gltf.load_model(str(SCENE)))
        self.room.reparent_to(self.root)
        self.camera.reparent_to(self.root)
        self.camera.set_pos(0, -0.8, 0.273)
        self.lens = self.camera.node().get_lens()
        self.lens.set_near_far(0.01, 10)
        self.region = self.frame.make_display_region()
        self.region.camera = self.camera
        self.look(*SIZE)

    def look(self, width: int, height: int) -> None:
        """Give the lens the shape of an image."""
        self.lens.set_fov(2 * degrees(atan(tan(radians(FOV_Y) / 2) * width / height)), FOV_Y)

    def draw(self) -> np.ndarray:
        """The next frame."""
        taskMgr.step()
        self.frame.engine.render_frame()
        pixels = np.frombuffer(self.texture.get_ram_image_as("RGB"), np.float32)
        return pixels.reshape(self.texture.y_size, self.texture.x_size, 3)[::-1].copy()


def card(host: Host) -> NodePath:
    """A white square before the middle of the camera's view."""
    maker = CardMaker("card")
    maker.set_frame(-0.1, 0.1, -0.1, 0.1)
    maker.set_has_normals(True)
    result = host.root.attach_new_node(maker.generate())
    result.set_pos(0, -0.3, 0.273)
    return result


def bumpy_card(host: Host) -> NodePath:
    """A white square on the back wall, with a normal map of one texel."""
    columns = GeomVertexArrayFormat()
    for name, count, kind in (("vertex", 3, "point"), ("normal", 3, "normal"), ("tangent", 4, "vector"),
                              ("texcoord", 2, "texcoord")):  # fmt: skip
        columns.add_column(name, count, GeomEnums.NT_float32, getattr(GeomEnums, f"C_{kind}"))
    corners = [(x, 0, z, 0, -1, 0, 1, 0, 0, 1, x, z) for x in (-0.2, 0.2) for z in (0.2, -0.2)]
    data = GeomVertexData("card", GeomVertexFormat.register_format(GeomVertexFormat(columns)), GeomEnums.UH_static)
    data.unclean_set_num_rows(4)
    data.modify_array_handle(0).copy_data_from(np.float32(corners).tobytes())
    strip = GeomTristrips(GeomEnums.UH_static)
    strip.add_next_vertices(4)
    geom = Geom(data)
    geom.add_primitive(strip)
    node = GeomNode("card")
    node.add_geom(geom)
    result = host.root.attach_new_node(node)
    result.set_pos(0, BACK, 0.273)
    texture, stage = Texture(), TextureStage("normal")
    texture.setup_2d_texture(1, 1, Texture.T_unsigned_byte, Texture.F_rgb)
    texture.set_ram_image(bytes(TEXEL[::-1]))  # blue first
    stage.mode = TextureStage.M_normal
    result.set_texture(stage, texture)
    return result


def difference(host: Host, light: BakedLight) -> np.ndarray:
    """What an attached light adds to the next frame."""
    lit = host.draw()
    light.detach(host.camera)
    bare = host.draw()
    light.attach(host.camera)
    return lit - bare


def added(host: Host, gi: str, y_up: bool = False) -> np.ndarray:
    """What light of the file `gi` adds to the frame. Afterwards nothing of it is left."""
    before = host.draw()
    light = BakedLight(gi, host.room, y_up)
    light.attach(host.camera)
    lit = host.draw()
    light.remove()
    assert np.array_equal(host.draw(), before)
    assert host.camera.get_num_children() == 0
    return lit - before


def frames(first: GraphicsOutput, gi: str, half_gi: str, bumpy_gi: str) -> dict[str, np.ndarray]:
    """Light that was added to frames, by what is special about them."""
    host = Host(first)
    result = {"plain": added(host, gi)}

    light = BakedLight(gi, host.room)
    light.attach(host.camera)
    result["whole again"] = difference(host, light)
    light.weights = {"lamps": 0.25, "sky": (1, 0.5, 2)}
    result["weighed"] = difference(host, light)
    light.remove()

    light = BakedLight(gi, host.room, scale=2.0)
    light.attach(host.camera)
    result["scaled"] = difference(host, light)
    light.scale = 1.0
    host.room.set_pos_hpr_scale(30, 4, -5, 70, 20, 10, 3, 3, 3)
    host.camera.reparent_to(host.room)
    host.camera.set_scale(1 / 3)
    result["moved"] = difference(host, light)
    host.frame.set_size(*LARGER)
    host.look(*LARGER)
    result["resized"] = difference(host, light)
    light.remove()

    host = Host(first)
    host.region.dimensions = 0, 0.5, 0, 1
    second = host.frame.make_display_region(0.5, 1, 0, 1)
    second.camera = host.camera
    host.look(SIZE[0] // 2, SIZE[1])
    result["halves"] = added(host, gi)

    host = Host(first)
    host.lens = OrthographicLens()
    host.lens.set_film_size(WIDTH, WIDTH * SIZE[1] / SIZE[0])
    host.lens.set_near_far(0.01, 10)
    host.camera.node().set_lens(host.lens)
    result["orthographic"] = added(host, gi)

    host = Host(first)
    host.room.remove_node()
    options = LoaderOptions(LoaderOptions.LF_search | LoaderOptions.LF_report_errors | LoaderOptions.LF_no_cache)
    host.room = NodePath(Loader.get_global_ptr().load_sync(SCENE, options))  # Panda3D's own reader
    host.room.reparent_to(host.root)
    host.room.set_p(90)
    result["own reader"] = added(host, gi, y_up=True)

    host = Host(first)
    bumpy = bumpy_card(host)
    result["bumpy"] = added(host, bumpy_gi)
    bumpy.set_two_sided(True)
    bumpy.set_h(180)
    result["bumpy behind"] = added(host, bumpy_gi)

    host = Host(first)
    result["bare"] = added(host, half_gi)
    pane = card(host)
    result["pane"] = added(host, half_gi)
    pane.set_transparency(TransparencyAttrib.M_alpha)
    pane.set_alpha_scale(0.25)
    result["glass"] = added(host, half_gi)
    material = Material()
    material.set_diffuse((1, 1, 0.5, 1))
    pane.set_material(material)
    pane.set_color_scale(0.5, 0, 1, 1)
    texture = Texture()
    texture.setup_2d_texture(1, 1, Texture.T_unsigned_byte, Texture.F_rgb)
    texture.set_ram_image(bytes([51, 255, 255]))  # blue first
    pane.set_texture(texture)
    result["coloured"] = added(host, half_gi)
    pane.set_tag("gsgi", "off")
    result["off"] = added(host, half_gi)
    return result


def tasks() -> int:
    """How many tasks are there besides the host's."""
    return len(taskMgr.getTasksNamed("gsgi baked light"))


def life(first: GraphicsOutput, gi: str) -> dict[str, np.ndarray]:
    """The frames of a host before there was light and after its room is gone, and the tasks that ran, step by step."""
    host, running = Host(first), []
    card(host)
    light = BakedLight(gi, host.room)
    running.append(tasks())
    light.attach(host.camera)
    running.append(tasks())
    host.draw()
    host.room.remove_node()
    left = host.draw()
    light.detach(host.camera)
    light.detach(host.camera)
    light.remove()
    running.append(tasks())
    return {"room removed": left, "light removed": host.draw(), "tasks": np.array(running)}


def message(call) -> str:
    """Type and text of the error that `call` raises."""
    try:
        call()
    except (ValueError, UnsupportedError) as error:
        return f"{type(error).__name__}: {error}"
    return "none"


def errors(first: GraphicsOutput, gi: str, over_gi: str) -> dict[str, str | list[str]]:
    """What mistakes say."""
    host, display = Host(first), Host(first, bits=8)
    light = BakedLight(gi, host.room)
    return {
        "display values": message(lambda: light.attach(display.camera)),
        "no camera": message(lambda: light.attach(host.room)),
        "over": message(lambda: BakedLight(over_gi, host.room)),
        "axes": message(lambda: BakedLight(gi, host.room, y_up=True)),
        "no scene": message(lambda: BakedLight(gi, NodePath("nothing").find("there"))),
        "scales": [message(lambda scale=scale: BakedLight(gi, host.room, scale=scale)) for scale in SCALES],
    }


if __name__ == "__main__":
    *files, out, config = [*sys.argv[1:], ""][:6]
    load_prc_file_data("", "\n".join(["load-display p3headlessgl", *config.split(";")]))
    context = output((1, 1), 8)
    np.savez(
        out, **frames(context, *files[:2], files[3]), **errors(context, files[0], files[2]), **life(context, files[0])
    )
