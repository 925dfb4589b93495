"""Metals: which surfaces are, and what becomes of their materials."""

from dataclasses import replace

import numpy as np
import pytest
import scenes

from gsgi.runtime.metals import has_metal, lambertian, metal_areas
from gsgi.runtime.scene import Material, Scene, Texture, TextureSlot

COLOR = (0.8, 0.6, 0.4, 1.0)
SLOT = TextureSlot(0)
METAL = Material("metal", COLOR, SLOT, metallic=1.0, normal_texture=SLOT)


def floor_of(material: Material, blue=(255, 0, 0, 0)) -> Scene:
    """A floor of 4 m^2 with one texture of four texels."""
    pixels = np.full((2, 2, 4), 255, np.uint8)
    pixels[..., 2] = np.reshape(blue, (2, 2))
    return Scene((scenes.floor(),), (material,), (Texture(pixels),))


@pytest.mark.parametrize(
    ("material", "blue", "has", "area"),
    [
        (Material(), (255,) * 4, False, 0),
        (METAL, (0,) * 4, True, 4),
        (replace(METAL, metallic=0.3), (0,) * 4, True, 0),
        (replace(METAL, metallic_texture=SLOT), (255, 0, 0, 0), True, 1),
        (replace(METAL, metallic=0.6, metallic_texture=SLOT), (255, 255, 100, 0), True, 2),
        (replace(METAL, metallic_texture=SLOT), (0,) * 4, False, 0),
        (replace(METAL, base_color=(0.0, 0.0, 0.0, 1.0)), (0,) * 4, False, 0),
    ],
)
def test_what_is_metal(material, blue, has, area):
    scene = floor_of(material, blue)
    areas, all_surface = metal_areas(scene)
    assert (has_metal(scene), areas.tolist(), all_surface) == (has, [pytest.approx(area)], pytest.approx(4))


def test_a_material_without_surface_is_no_metal():
    assert not has_metal(replace(floor_of(Material()), materials=(Material(), METAL)))


def test_a_rough_metal_keeps_its_look_and_is_metallic_no_more():
    (material,) = lambertian(floor_of(replace(METAL, metallic_texture=SLOT))).materials
    assert material == replace(METAL, metallic=0.0)


def test_a_black_metal_needs_no_textures_except_for_its_holes():
    def black(material: Material) -> Material:
        return lambertian(replace(floor_of(material), metals="black")).materials[0]

    assert black(METAL) == replace(METAL, base_color_texture=None, normal_texture=None)
    assert black(replace(METAL, alpha_cutoff=0.5)) == replace(METAL, alpha_cutoff=0.5, normal_texture=None)
    for partly in (replace(METAL, metallic=0.9), replace(METAL, metallic_texture=SLOT)):
        assert black(partly) == partly


@pytest.mark.parametrize("color", [0.25, 0.5, 0.95])
def test_the_base_colour_is_what_a_metal_reflects_on_average(color):
    """Schlick's Fresnel term of glTF over a white sky: color + (1 - color) / 21 (Kulla and Conty 2017)."""
    cosine = (np.arange(10000) + 0.5) / 10000
    reflected = (2 * cosine * (color + (1 - color) * (1 - cosine) ** 5)).mean()
    assert reflected == pytest.approx(color + (1 - color) / 21, rel=1e-6)
    assert 0 < reflected - color < 0.04
