"""The scene that a frame shows, as the bake took it whose light it has."""

from dataclasses import replace
from typing import TYPE_CHECKING

from .gaussians import Bake, Effects
from .scene import Material, Scene

if TYPE_CHECKING:
    from .world.world import World


def as_baked(scene: Scene, bake: "Bake | World | None") -> Scene:
    """The scene with the metals and panes that `bake` was made with, since B belongs to those; without one as it is.

    Where B has the light that lamps send through clear panes, these cast shadows.
    """
    if bake is None:
        return scene
    materials = scene.materials if Effects.CLEAR_PANE in bake.effects else tuple(map(_shading, scene.materials))
    return replace(scene, materials=materials, metals="rough" if Effects.METAL in bake.effects else "black")


def _shading(material: Material) -> Material:
    of = material.filter
    return replace(material, filter=replace(of, clear=0.0)) if of and of.clear else material
