"""The light of a bake in the frames of Panda3D's cameras."""

from math import inf
from numbers import Real
from pathlib import Path
from types import MappingProxyType

import numpy as np
from direct.task import Task
from direct.task.TaskManagerGlobal import taskMgr
from panda3d.core import (
    CS_default,
    CS_yup_right,
    DisplayRegion,
    GraphicsOutput,
    LMatrix4,
    Material,
    MaterialAttrib,
    NodePath,
    PythonTask,
    RenderState,
    ShaderAttrib,
)

from gsgi.runtime.errors import UnsupportedError
from gsgi.runtime.file.reader import read_bake
from gsgi.runtime.gaussians import Bake, Effects
from gsgi.runtime.light_groups import Factors, Weights, factors_of, weighted
from gsgi.runtime.lookup_tables import lookup_tables, recoloured, sh_counts
from gsgi.runtime.sampling import check_operator

from .layer import Layer
from .shaders import check_glsl, shader
from .textures import fill, lookup_textures

_OVERRIDE = 1000  # priority above that of any shader of a node
_BEFORE_DRAWING = 48  # sort of the task; igLoop, which draws, has 50
_INSIDE = 0.5  # part of the Gaussians that lies within the bounds of their scene, at least
_SLACK = 0.1  # of the scene's diagonal


class BakedLight:
    """Adds the light of `gi`, the path of a .gsgi file or a decoded `Bake`, to the frames of Panda3D's cameras.

    `scene` is the NodePath of the model that was loaded from the glTF file of the bake; the light moves and turns with
    it. panda3d-gltf turns models to +Z up; `y_up` says that this one keeps glTF's axes, as Panda3D's own loader
    (Assimp) leaves them. `scale`: radiance in the frame per radiance in the bake, for lights in other units than
    glTF's. panda3d-gltf makes point and spot lights 4 pi / 683 and directional ones 1 / 683 times as bright as glTF.

    There is no light while the scene is removed. Raises FileError or FormatError for the file, UnsupportedError for one
    of the `over` operator, and ValueError for an empty NodePath, for a scale that is not a number from 0 on, and if
    most of the Gaussians lie outside the scene.
    """

    def __init__(self, gi: str | Path | Bake, scene: NodePath, y_up: bool = False, scale: float = 1.0):
        bake = gi if isinstance(gi, Bake) else read_bake(gi)
        check_operator(bake)
        if scene.is_empty():
            raise ValueError("scene: expected the NodePath of a model, got an empty one")
        self.scene, self.scale = scene, scale
        self._bake_from_scene = LMatrix4.ident_mat() if y_up else LMatrix4.convert_mat(CS_default, CS_yup_right)
        self._check_place(bake)
        self._cameras: list[NodePath] = []
        self._layers: dict[DisplayRegion, Layer] = {}
        self._adding = shader("add")
        self._state = ShaderAttrib.make(shader("light", sh_counts(bake)), _OVERRIDE)
        self._state = self._state.set_flag(ShaderAttrib.F_hardware_skinning, False)  # Panda3D moves vertices instead
        self._bake, self._weights = bake, factors_of(bake, {})
        tables = lookup_tables(bake)
        self._texels, textures = tables[0], lookup_textures(tables)
        self._gaussians = textures["gsgi_gaussians"]
        inputs = textures | {"black_metal": float(Effects.METAL not in bake.effects)}
        for name, value in inputs.items():
            self._state = self._state.set_shader_input(name, value, _OVERRIDE)
        white = Material()
        white.base_color = 1, 1, 1, 1
        self._white = RenderState.make(MaterialAttrib.make(white))  # of nodes without a material
        self._task: PythonTask | None = None  # while a camera is attached

    @property
    def scale(self) -> float:
        """Radiance in the frame per radiance in the bake, to read and to set."""
        return self._scale

    @scale.setter
    def scale(self, scale: float) -> None:
        if not (isinstance(scale, Real) and 0 <= scale < inf):
            raise ValueError(f"scale: expected a number from 0 on, got {scale!r}")
        self._scale = float(scale)

    @property
    def weights(self) -> Factors:
        """The weight of each of the bake's light groups, to read and to set as that of IndirectLight.

        Lights of Panda3D that stand for a group are the host's to dim.
        """
        return MappingProxyType(self._weights)

    @weights.setter
    def weights(self, weights: Weights) -> None:
        factors = factors_of(self._bake, weights)
        if factors != self._weights:
            fill(self._gaussians, recoloured(self._texels, weighted(self._bake, factors)))
            self._weights = factors

    def attach(self, camera: NodePath) -> None:
        """Add the light to all that `camera` shows in linear colours, from the next frame on.

        Raises ValueError for a NodePath that holds no camera, and UnsupportedError if no frame of the camera is linear,
        or if the driver lacks what the light needs.
        """
        if not hasattr(camera.node(), "display_regions"):
            raise ValueError(f"camera: {camera} holds no Camera")
        regions = camera.node().display_regions
        if len(regions) and not any(_is_linear(region.window) for region in regions):
            raise UnsupportedError(
                f"camera: {regions[0].window.name} holds display values, light can only be added to linear radiance: "
                "draw with simplepbr, or set `framebuffer-srgb true` in Panda3D's configuration"
            )
        if camera not in self._cameras:
            self._cameras.append(camera)
        self._task = self._task or taskMgr.add(self._follow, "gsgi baked light", sort=_BEFORE_DRAWING)
        self._follow()

    def detach(self, camera: NodePath) -> None:
        """Leave the frames of `camera` as they were before attach(). Calling it twice is harmless."""
        if camera in self._cameras:
            self._cameras.remove(camera)
        self._follow()
        if self._task and not self._cameras:
            taskMgr.remove(self._task)
            self._task = None

    def remove(self) -> None:
        """Detach all cameras and free the memory. Calling it twice is harmless."""
        for camera in list(self._cameras):
            self.detach(camera)

    def _follow(self, task=None) -> int:
        """Give each display region of the cameras a layer, and each layer the state of this frame."""
        cameras = [] if self.scene.is_empty() else [camera for camera in self._cameras if not camera.is_empty()]
        shown = [r for camera in cameras for r in camera.node().display_regions if _is_linear(r.window)]
        for region in set(self._layers).difference(shown):
            self._layers.pop(region).remove()
        if not shown:
            return Task.cont
        shading, unlit = self._shading(self.scale), self._shading(0.0)
        for region in shown:
            if region not in self._layers:
                check_glsl(region.window)
                self._layers[region] = Layer(region, self._adding)
            self._layers[region].follow(shading, unlit)
        return Task.cont

    def _shading(self, scale: float) -> RenderState:
        bake_from_world = self.scene.get_net_transform().get_inverse().get_mat() * self._bake_from_scene
        state = self._state.set_shader_input("bake_from_world", bake_from_world, _OVERRIDE)
        return self._white.set_attrib(state.set_shader_input("scale", scale, _OVERRIDE), _OVERRIDE)

    def _check_place(self, bake: Bake) -> None:
        bounds = self.scene.get_tight_bounds(self.scene)
        if bounds is None:
            return
        corners = np.array([self._bake_from_scene.xform_point(corner) for corner in bounds])
        low, high = corners.min(axis=0), corners.max(axis=0)
        slack = _SLACK * np.linalg.norm(high - low)
        position = bake.gaussians.position
        inside = ((position > low - slack) & (position < high + slack)).all(axis=1).mean()
        if inside < _INSIDE:
            raise ValueError(
                f"scene: {inside:.0%} of the bake's Gaussians lie within {self.scene}: is it the scene of this bake, "
                f"and does it have +{'Y' if self._bake_from_scene.is_identity() else 'Z'} up?"
            )


def _is_linear(host: GraphicsOutput) -> bool:
    """Whether colours of `host` are linear to whoever draws them."""
    properties = host.get_fb_properties()
    return properties.srgb_color or properties.float_color or properties.red_bits >= 16
