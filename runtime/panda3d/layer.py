"""albedo * B as a layer of its own over what one display region shows."""

from panda3d.core import (
    Camera,
    CardMaker,
    ColorBlendAttrib,
    ColorWriteAttrib,
    DepthTestAttrib,
    DepthWriteAttrib,
    DisplayRegion,
    FrameBufferProperties,
    GraphicsOutput,
    GraphicsPipe,
    NodePath,
    OmniBoundingVolume,
    RenderState,
    Shader,
    Texture,
    WindowProperties,
)

from gsgi.runtime.errors import UnsupportedError

TAG = "gsgi"  # of nodes; with the value "off" they get no light


class Layer:
    """Draws what `region` shows again, into a texture of half floats, and adds the texture to the region by `adding`.

    Blending is linear in colours, so the sum of both layers is the frame under both kinds of light. Raises
    UnsupportedError where the driver has no such texture.
    """

    def __init__(self, region: DisplayRegion, adding: Shader):
        host, light = region.window, Texture("gsgi light")
        self._region = region
        self._camera = region.camera.attach_new_node(Camera("gsgi light"))
        self._camera.node().tag_state_key = TAG
        self._buffer = _buffer(host, self._size(), light)
        self._buffer.make_display_region().camera = self._camera
        self._card = _card(adding, light)
        self._added = host.make_display_region()
        self._added.camera = NodePath(Camera("gsgi light"))
        self._added.camera.node().scene = self._card

    def follow(self, shading: RenderState, unlit: RenderState) -> None:
        """Take over what may have changed in the region, its camera and the state to draw nodes with."""
        region, host, followed, own = self._region, self._region.window, self._region.camera.node(), self._camera.node()
        own.set_lens(followed.get_lens(region.lens_index))
        own.camera_mask, own.scene, own.lod_scale = followed.camera_mask, followed.scene, followed.lod_scale
        own.initial_state = followed.initial_state.compose(shading)
        own.set_tag_state("off", unlit)
        if self._buffer.size != self._size():
            self._buffer.set_size(*self._size())
        self._buffer.active = self._added.active = region.active and host.active
        self._buffer.sort = host.sort - 1
        self._added.dimensions, self._added.sort = region.dimensions, region.sort + 1
        corner = int(region.get_left() * host.get_x_size() + 0.5), int(region.get_bottom() * host.get_y_size() + 0.5)
        self._card.set_shader_input("corner", corner)

    def remove(self) -> None:
        """Leave region and camera as they were."""
        self._region.window.remove_display_region(self._added)
        self._buffer.engine.remove_window(self._buffer)
        self._camera.remove_node()

    def _size(self) -> tuple[int, int]:
        return max(self._region.get_pixel_width(), 1), max(self._region.get_pixel_height(), 1)


def _buffer(host: GraphicsOutput, size: tuple[int, int], light: Texture) -> GraphicsOutput:
    """A buffer of `size` px that is drawn into `light`, with as many samples per pixel as `host` has."""
    properties = FrameBufferProperties()
    properties.float_color, properties.depth_bits = True, 24
    properties.set_rgba_bits(16, 16, 16, 16)
    properties.multisamples = host.get_fb_properties().multisamples
    buffer = host.engine.make_output(
        host.pipe, "gsgi light", host.sort - 1, properties, WindowProperties.size(*size), GraphicsPipe.BF_refuse_window,
        host.gsg, host,
    )  # fmt: skip
    if not buffer:
        raise UnsupportedError(f"{host.gsg.driver_renderer} offers no buffer of half floats, which baked light needs")
    light.set_format(Texture.F_rgba16)
    light.set_component_type(Texture.T_half_float)
    buffer.add_render_texture(light, GraphicsOutput.RTM_bind_or_copy, GraphicsOutput.RTP_color)
    buffer.set_clear_color_active(True)
    buffer.clear_color = 0, 0, 0, 0
    return buffer


def _card(adding: Shader, light: Texture) -> NodePath:
    """What covers the view and is added to it."""
    card = NodePath(CardMaker("gsgi light").generate())
    card.node().set_bounds(OmniBoundingVolume())
    card.set_shader(adding)
    card.set_shader_input("light", light)
    rgb = ColorWriteAttrib.C_red | ColorWriteAttrib.C_green | ColorWriteAttrib.C_blue
    for attribute in (
        ColorBlendAttrib.make(ColorBlendAttrib.M_add, ColorBlendAttrib.O_one, ColorBlendAttrib.O_one),
        ColorWriteAttrib.make(rgb), DepthTestAttrib.make(DepthTestAttrib.M_none), DepthWriteAttrib.make(False),
    ):  # fmt: skip
        card.set_attrib(attribute)
    return card
