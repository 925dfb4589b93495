"""pyrender's `OffscreenRenderer` with baked indirect light: takes pyrender's own scenes, by duck typing.

    from gsgi.runtime.pyrender import OffscreenRenderer, RenderFlags

    renderer = OffscreenRenderer(640, 480, gi="room.gsgi")
    color, depth = renderer.render(scene, RenderFlags.SHADOWS_DIRECTIONAL)

Colours are those of pyrender 0.1.45: its metallic-roughness surfaces, ambient light, shadow maps, four samples per
pixel, `pow(1 / 2.2)`. With `gi`, `base colour * (1 - metallic) * B` is added before that curve. What else differs:

- Depth of an OrthographicCamera is metres along the view axis; pyrender reads its buffer as a perspective one.
- Shadows need no `np.infty`, which numpy 2 lacks, and SHADOWS_ALL works where no point light is in the scene.
- With shadows too, a mesh is lit by four lights of a kind: the nearest ones.
- UnsupportedError: the flags VERTEX_NORMALS and FACE_NORMALS, SpecularGlossinessMaterial (pyrender draws it undefined),
  and `gi` with an OrthographicCamera.

As in pyrender, alphaMode MASK cuts no holes, a light's `range` is ignored, and the emissive factor counts twice.
Indirect light falls on triangles with an alpha of 1, not on points, lines, wireframes or what blends.

pyrender itself need not be installed; the extra `gsgi[pyrender]` brings it.
"""

from .flags import RenderFlags
from .offscreen import OffscreenRenderer

__all__ = ["OffscreenRenderer", "RenderFlags"]
