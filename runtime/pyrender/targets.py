"""Framebuffers in pyrender's formats: four samples per pixel, and the image that they resolve to."""

import moderngl
import numpy as np

_SAMPLES = 4


class Targets:
    """Colour RGBA8 and depth of (width, height) px: `drawn` holds the samples, `resolved` one value per pixel."""

    def __init__(self, ctx: moderngl.Context, size: tuple[int, int]):
        self.ctx, self.size = ctx, size
        samples = min(_SAMPLES, ctx.max_samples)
        self.drawn = ctx.framebuffer(
            ctx.renderbuffer(size, 4, samples=samples), ctx.depth_renderbuffer(size, samples=samples)
        )
        self.resolved = ctx.framebuffer(ctx.renderbuffer(size, 4), ctx.depth_renderbuffer(size))

    def resolve(self) -> None:
        """Resolve the samples: a colour is the average of the encoded colours, a depth is that of one sample."""
        self.ctx.copy_framebuffer(self.resolved, self.drawn)

    def color(self, channels: int) -> np.ndarray:
        """(H, W, channels) uint8, row 0 on top, writable."""
        return self._read(channels, 0, "f1", np.uint8)

    def depth(self) -> np.ndarray:
        """(H, W) float32 in [0, 1], row 0 on top; 1 where nothing was drawn."""
        return self._read(1, -1, "f4", np.float32)[..., 0]

    def release(self) -> None:
        """Free the GPU memory."""
        for target in (self.drawn, self.resolved):
            for attachment in (*target.color_attachments, target.depth_attachment):
                attachment.release()
            target.release()

    def _read(self, channels: int, attachment: int, kind: str, dtype: type) -> np.ndarray:
        raw = self.resolved.read(components=channels, attachment=attachment, alignment=1, dtype=kind)
        width, height = self.size
        return np.frombuffer(raw, dtype).reshape(height, width, channels)[::-1].copy()
