"""Text over a picture, in its upper left corner."""

import moderngl
import numpy as np

from gsgi.runtime.gl.fullscreen import FullScreenPass

MARGIN = 3  # px around the text
LARGER = 2  # magnification, if the text then covers at most half of the picture's width
SHADE = 150  # of 255; opacity behind the letters


class Overlay:
    """Draws the text that was last passed to `write`. An empty text draws nothing."""

    def __init__(self, ctx: moderngl.Context):
        self.ctx, self.text = ctx, ""
        self._texture: moderngl.Texture | None = None
        self._pass = FullScreenPass(ctx, "viewer/overlay", ("text",))

    def write(self, text: str) -> None:
        """Replace the text, which has one or more lines."""
        if text == self.text:
            return
        self.text = text
        self._drop()
        if text:
            image = letters(text)
            self._texture = self.ctx.texture(image.shape[1::-1], 4, np.ascontiguousarray(image))

    def draw(self, target: moderngl.Framebuffer, size: tuple[int, int]) -> None:
        """Blend the text into `target` of `size` (width, height) px, whose viewport is kept; excess text is cut off."""
        if not self._texture:
            return
        scale = LARGER if 2 * LARGER * self._texture.width <= size[0] else 1
        width, height = (scale * edge for edge in self._texture.size)
        corner = 0, size[1] - height
        before = target.viewport
        self.ctx.enable_only(moderngl.BLEND)
        self.ctx.blend_func = moderngl.ONE, moderngl.ONE_MINUS_SRC_ALPHA
        self._pass.draw(target, self._texture, viewport=(*corner, width, height), corner=corner, scale=scale)
        target.viewport = before

    def release(self) -> None:
        """Free the GPU memory."""
        self._drop()
        self._pass.release()

    def _drop(self) -> None:
        if self._texture:
            self._texture.release()
        self._texture = None


def letters(text: str) -> np.ndarray:
    """White monospaced text on a shade: (H, W, 4) uint8, premultiplied, row 0 on top."""
    from PIL import Image, ImageDraw, ImageFont

    font = ImageFont.load_default_imagefont()  # a bitmap
    _, _, width, height = ImageDraw.Draw(Image.new("L", (1, 1))).multiline_textbbox((0, 0), text, font, spacing=2)
    ink = Image.new("L", (int(width) + 2 * MARGIN, int(height) + 2 * MARGIN))
    ImageDraw.Draw(ink).multiline_text((MARGIN, MARGIN), text, 255, font, spacing=2)
    white = np.asarray(ink)
    alpha = white + ((255 - white.astype(int)) * SHADE // 255).astype(np.uint8)
    return np.stack([white, white, white, alpha], axis=2)
