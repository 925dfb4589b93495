"""pyrender's `OffscreenRenderer` with baked indirect light. Accepts pyrender's own scenes by duck typing.

    from gsgi.runtime.pyrender import OffscreenRenderer, RenderFlags

    renderer = OffscreenRenderer(640, 480, gi="room.gsgi")
    color, depth = renderer.render(scene, RenderFlags.SHADOWS_DIRECTIONAL)

Colours are those of pyrender 0.1.45: its metallic-roughness surfaces, ambient light, shadow maps, four samples per
pixel, and `pow(1 / 2.2)`. With `gi`, `base colour * B` is added before that curve, of which metals get nothing if the
bake has them black; it follows normal maps where the bake says how. `renderer.weights` dims the light groups of a bake.
Other differences:

- Depth of an OrthographicCamera is in metres along the view axis; pyrender reads its depth buffer as perspective.
- Shadows do not need `np.infty`, which numpy 2 lacks, and SHADOWS_ALL works if the scene has no point light.
- A mesh is lit by the four nearest lights of each kind, with shadows too.
- UnsupportedError: the flags VERTEX_NORMALS and FACE_NORMALS, SpecularGlossinessMaterial (pyrender draws it undefined),
  a texture that the driver cannot hold, and `gi` of the `over` operator with an OrthographicCamera.

As in pyrender, alphaMode MASK cuts no holes, blended surfaces cast shadows (bake with `--transparent shade`), a light's
`range` is ignored, and the emissive factor counts twice.
Indirect light falls on triangles, but not on points, lines or wireframes. Blended ones have none with a bake of `over`.

pyrender itself need not be installed; the extra `gsgi[pyrender]` installs it.
"""

from .flags import RenderFlags
from .offscreen import OffscreenRenderer

__all__ = ["OffscreenRenderer", "RenderFlags"]
