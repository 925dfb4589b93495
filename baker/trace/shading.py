"""Surface properties at hits, for the path tracer's kernels: look-ups in the tables of `surface_tables`.

Import this only inside the tracing stage: importing it starts Mitsuba. A texture is read either exactly (bilinear, like
the G-buffer) or at one texel sampled with the bilinear weights as probabilities, which has the same expectation (Pharr
et al. 2024, "Filtering after shading with stochastic texture filtering") and suffices where the value enters linearly.
"""

import numpy as np

from .mitsuba_scene import load_mitsuba, on_device
from .places import Places
from .surface_tables import NEAREST, NO_TEXTURE, UV_SHIFT, WRAP, Surfaces

mi = load_mitsuba()

import drjit as dr  # noqa: E402  (needs the LLVM that load_mitsuba chose)

# From this value on, metallic is 1 to the eight bits of its texture, and the remaining diffuse light is invisible.
METAL = 1 - 0.5 / 255


def _srgb_table() -> np.ndarray:
    """Linear value of each sRGB code (IEC 61966-2-1): (256,) float32."""
    code = np.arange(256) / 255
    return np.where(code <= 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4).astype(np.float32)


class Shading:
    """The tables of one scene on the device. `smooth`, `colored`, `slots` say which look-ups a kernel needs.

    `moved` is how far the triangles were moved off the scene's, m. Triangles are given by their numbers (see
    `surface_tables.Placed`).
    """

    def __init__(self, surfaces: Surfaces, moved: float, places: Places):
        def floats(array):
            return on_device(mi.Float, array)

        def words(array):
            return on_device(mi.UInt32, array)

        self.places = places
        self.face, self.albedo_table = floats(surfaces.face), floats(surfaces.albedo)
        self.planes = floats(surfaces.plane)
        self.moved = moved
        off = float(surfaces.plane[:, 1].max(initial=0))
        self.inaccuracy = dr.opaque(mi.Float, max(places.most(off), moved))
        self.surface, self.emission_table = floats(surfaces.surface), floats(surfaces.emission)
        self.filters = None if surfaces.filters is None else floats(surfaces.filters)
        self.smooth = surfaces.normal is not None
        self.normal = words(surfaces.normal) if self.smooth else None
        self.tangent = None if surfaces.tangent is None else floats(surfaces.tangent)
        self.channels = surfaces.uv.shape[1]
        self.uv = floats(surfaces.uv) if self.channels else None
        self.colored = surfaces.color is not None
        self.color = floats(surfaces.color) if self.colored else None
        self.slots = {name: words(table) for name, table in surfaces.slots.items()}
        self.texels = words(surfaces.texels)
        self.linear = floats(_srgb_table())
        self.metallic = "metallic_texture" in self.slots or bool((surfaces.albedo[:, 3] > 0).any())
        self.double_sided = bool((surfaces.surface[:, 2] > 0).any())

    def frame(self, prim, active):
        """Geometric normal of triangle `prim` on its front side, and the index of its material."""
        row = dr.gather(mi.Vector4f, self.face, self.places.row(prim), active)
        normal = self.places.normal(prim, mi.Normal3f(row.x, row.y, row.z), active)
        return normal, dr.reinterpret_array(mi.UInt32, row.w)

    def plane(self, prim, active):
        """Distance of the plane of triangle `prim` from the origin, and how far off it rays may meet it, both m."""
        row = self.places.row(prim)
        plane = dr.gather(mi.Vector2f, self.planes, row, active)
        return self.places.plane(prim, lambda: dr.gather(mi.Vector4f, self.face, row, active), plane, active)

    def shading_normal(self, prim, b, ng, active):
        """Interpolated unit normal at barycentric coordinates `b`, on the side of the geometric normal `ng`."""
        if not self.smooth:
            return mi.Normal3f(ng)
        n = self._interpolated(prim, b, ng, active)
        return mi.Normal3f(dr.select(dr.dot(n, ng) < 0, -n, n))

    def mapped_normal(self, material, prim, b, ng, active):
        """The shading normal perturbed by the normal texture (glsl/lib/normal_map.glsl). It may face away from `ng`."""
        n = self._interpolated(prim, b, ng, active)
        side = dr.select(dr.dot(n, ng) < 0, -1, 1)
        if "normal_texture" not in self.slots:
            return n * side
        slot = self._slot("normal_texture", material, active)
        active = active & (slot.x != NO_TEXTURE)
        texel = self._exact(slot, self._uv(slot, prim, b, active), active, linear=False)
        scale = dr.gather(mi.Vector4f, self.surface, material, active).w
        local = mi.Vector3f(texel.x, texel.y, texel.z) * 2 - 1
        row = self.places.row(prim)
        corners = (dr.gather(mi.Vector4f, self.tangent, 3 * row + k, active) for k in range(3))
        tangent = _weighted(b, *(self.places.tangent(prim, corner, active) for corner in corners))
        t = mi.Vector3f(tangent.x, tangent.y, tangent.z)
        t -= n * dr.dot(n, t)
        length = dr.norm(t)
        t /= length
        bitangent = dr.select(tangent.w < 0, -1, 1) * dr.cross(n, t)
        bent = t * local.x * scale + bitangent * local.y * scale + n * local.z
        usable = active & (length > 0) & (dr.norm(bent) > 0)
        return side * mi.Normal3f(dr.select(usable, dr.normalize(bent), n))

    def _interpolated(self, prim, b, ng, active):
        """Interpolated unit normal on the side that the file gives; `ng` where the interpolation gives 0."""
        if not self.smooth:
            return self.frame(prim, active)[0]
        codes = dr.gather(mi.Vector4u, self.normal, self.places.row(prim), active)
        corners = (_from_octahedral(code) for code in (codes.x, codes.y, codes.z))
        n = _weighted(b, *(self.places.normal(prim, corner, active) for corner in corners))
        length = dr.norm(n)
        return mi.Normal3f(dr.select(length > 0, n / length, ng))

    def hole(self, prim, b, active):
        """Whether there is an alpha-tested hole at `b`: factor * texture * vertex colour is below the cut-off."""
        _, material = self.frame(prim, active)
        row = dr.gather(mi.Vector4f, self.surface, material, active)
        return active & (self.opacity(material, prim, b, active) < row.y)

    def opacity(self, material, prim, b, active):
        """Alpha: factor * texture * vertex colour."""
        factor = dr.gather(mi.Vector4f, self.surface, material, active).x
        return factor * self._base(material, prim, b, active, None).w

    def filtered(self, prim, b, active):
        """What a triangle that lets light through transmits (Color3f), the share of light from it, where it is, and
        where it casts a shadow.

        The share is the factor on what it reflects and emits; the two add up to at most 1 in each channel. In its
        holes, where it is not, they are 1 and 0.
        """
        _, material = self.frame(prim, active)
        row = dr.gather(mi.Vector4f, self.surface, material, active)
        clear, blends, transmission, stained = dr.gather(mi.Vector4f, self.filters, material, active)
        factor = dr.gather(mi.Vector4f, self.albedo_table, material, active)
        base = self._base(material, prim, b, active, None)
        tint = dr.clip(mi.Color3f(factor.x, factor.y, factor.z) * mi.Color3f(base.x, base.y, base.z), 0, 1)
        alpha = dr.clip(row.x * base.w, 0, 1)
        hole = alpha < row.y
        covered = dr.select(hole, 0, dr.select(blends > 0, alpha, 1))
        through = (1 - covered) * dr.select((stained > 0) & ~hole, tint, 1) + covered * transmission * tint
        is_there = active & ~hole
        return through, covered * (1 - transmission), is_there, is_there & (alpha >= clear)

    def is_filter(self, material, active):
        """Whether the material lets light through."""
        return active & (dr.gather(mi.Vector4f, self.filters, material, active).z >= 0)

    def is_double_sided(self, material, active):
        if not self.double_sided:
            return mi.Bool(False)
        return dr.gather(mi.Vector4f, self.surface, material, active).z > 0

    def albedo(self, material, prim, b, active, jitter=None):
        """Linear base colour * (1 - metallic): exact, or from one texel with `jitter` (a function: name -> Point2f)."""
        row = dr.gather(mi.Vector4f, self.albedo_table, material, active)
        base = self._base(material, prim, b, active, jitter)
        albedo = mi.Color3f(row.x, row.y, row.z) * mi.Color3f(base.x, base.y, base.z)
        if self.metallic:
            albedo *= 1 - self._metallic(material, prim, b, active, jitter)
        return albedo

    def diffuse(self, material, prim, b, active):
        """Whether B is seen at `b`: the surface is neither unlit nor metal that reflects nothing. It may be black."""
        lit = active & (dr.gather(mi.Vector4f, self.emission_table, material, active).w == 0)
        if not self.metallic:
            return lit
        return lit & (self._metallic(material, prim, b, lit, None) < METAL)

    def emission(self, material, prim, b, active, jitter=None):
        """Emitted radiance that lights the scene; 0 for unlit materials."""
        row = dr.gather(mi.Vector4f, self.emission_table, material, active)
        texel = self._texture("emission_texture", material, prim, b, active, jitter)
        radiance = mi.Color3f(row.x, row.y, row.z) * mi.Color3f(texel.x, texel.y, texel.z)
        return dr.select(active & (row.w == 0), radiance, 0)

    def shown(self, material, prim, b, active):
        """Albedo and emission as a camera sees them: an unlit surface emits its base colour and reflects nothing."""
        row = dr.gather(mi.Vector4f, self.emission_table, material, active)
        base = self._base(material, prim, b, active, None)
        unlit = row.w > 0
        color = mi.Color3f(row.x, row.y, row.z) * mi.Color3f(base.x, base.y, base.z)
        albedo = self.albedo(material, prim, b, active)
        return dr.select(unlit, 0, albedo), dr.select(unlit, color, self.emission(material, prim, b, active))

    def _metallic(self, material, prim, b, active, jitter):
        """Metallic: factor * texture."""
        factor = dr.gather(mi.Vector4f, self.albedo_table, material, active).w
        return factor * self._texture("metallic_texture", material, prim, b, active, jitter, linear=False).z

    def _base(self, material, prim, b, active, jitter):
        """Base colour texture (linear, alpha in w) * vertex colour."""
        value = self._texture("base_color_texture", material, prim, b, active, jitter)
        if self.colored:
            row = self.places.row(prim)
            corners = (dr.gather(mi.Vector4f, self.color, 3 * row + k, active) for k in range(3))
            value *= _weighted(b, *corners)
        return value

    def _texture(self, name, material, prim, b, active, jitter, linear=True):
        """Value of the texture of kind `name`, 1 where the material has none."""
        if name not in self.slots:
            return mi.Vector4f(1)
        slot = self._slot(name, material, active)
        active = active & (slot.x != NO_TEXTURE)
        uv = self._uv(slot, prim, b, active)
        value = (
            self._one_texel(slot, uv, jitter(name), active, linear) if jitter else self._exact(slot, uv, active, linear)
        )
        return dr.select(active, value, 1)

    def _slot(self, name, material, active):
        return dr.gather(mi.Vector4u, self.slots[name], material, active)

    def _uv(self, slot, prim, b, active):
        prim = self.places.row(prim)
        row = 2 * prim if self.channels == 1 else 2 * (prim * self.channels + (slot.w >> UV_SHIFT))
        first = dr.gather(mi.Vector4f, self.uv, row, active)
        third = dr.gather(mi.Vector4f, self.uv, row + 1, active)
        return _weighted(b, mi.Point2f(first.x, first.y), mi.Point2f(first.z, first.w), mi.Point2f(third.x, third.y))

    def _one_texel(self, slot, uv, jitter, active, linear):
        """One texel, sampled with its bilinear weight as the probability."""
        nearest = (slot.w & NEAREST) != 0
        x, y = (_unwrapped(c, size, mode) + dr.select(nearest, 0.5, u) - 0.5
                for c, size, mode, u in _axes(slot, uv, jitter))  # fmt: skip
        return self._texel(slot, mi.Int32(dr.floor(x)), mi.Int32(dr.floor(y)), active, linear)

    def _exact(self, slot, uv, active, linear):
        """The bilinear value of four texels, or the nearest texel, depending on the sampler."""
        nearest = (slot.w & NEAREST) != 0
        x, y = (_unwrapped(c, size, mode) - dr.select(nearest, 0, 0.5) for c, size, mode, _ in _axes(slot, uv, uv))
        x0, y0 = dr.floor(x), dr.floor(y)
        fx, fy = dr.select(nearest, 0, x - x0), dr.select(nearest, 0, y - y0)
        x0, y0 = mi.Int32(x0), mi.Int32(y0)
        rows = []
        for j in (0, 1):
            left, right = (self._texel(slot, x0 + i, y0 + j, active, linear) for i in (0, 1))
            rows.append(left + fx * (right - left))
        return rows[0] + fy * (rows[1] - rows[0])

    def _texel(self, slot, x, y, active, linear):
        """Red, green, blue (linear light where `linear`, else the stored value) and alpha of one texel."""
        width, height = mi.Int32(slot.y), mi.Int32(slot.z)
        x, y = _wrapped(x, width, slot.w & 3), _wrapped(y, height, (slot.w >> 2) & 3)
        code = dr.gather(mi.UInt32, self.texels, slot.x + mi.UInt32(y * width + x), active)
        channels = [(code >> shift) & 255 for shift in (0, 8, 16)]
        if linear:
            color = [dr.gather(mi.Float, self.linear, channel, active) for channel in channels]
        else:
            color = [mi.Float(channel) * (1 / 255) for channel in channels]
        return mi.Vector4f(*color, mi.Float(code >> 24) * (1 / 255))


def _axes(slot, uv, jitter):
    modes = slot.w & 3, (slot.w >> 2) & 3
    return zip(uv, (mi.Float(slot.y), mi.Float(slot.z)), modes, jitter, strict=True)


def _unwrapped(coordinate, size, mode):
    """Texture coordinate in texels, wrapped into the texture first so that large coordinates keep their precision."""
    repeated = coordinate - dr.floor(coordinate)
    folded = 1 - dr.abs(1 - 2 * (coordinate / 2 - dr.floor(coordinate / 2)))
    clamped = dr.clip(coordinate, 0, 1)
    return size * dr.select(mode == WRAP["repeat"], repeated, dr.select(mode == WRAP["mirror"], folded, clamped))


def _wrapped(index, size, mode):
    """Texel index within the texture: one step past an edge wraps around when repeating, else is clamped."""
    around = dr.select(index < 0, index + size, dr.select(index >= size, index - size, index))
    return dr.select(mode == WRAP["repeat"], around, dr.clip(index, 0, size - 1))


def _weighted(b, first, second, third):
    return first * (1 - b.x - b.y) + second * b.x + third * b.y


def _from_octahedral(code):
    """Unit direction from two signed 16-bit parts."""
    x = mi.Float(mi.Int32(code << 16) >> 16) * (1 / 32767)
    y = mi.Float(mi.Int32(code) >> 16) * (1 / 32767)
    z = 1 - dr.abs(x) - dr.abs(y)
    fold = dr.maximum(-z, 0)
    n = mi.Vector3f(x - dr.select(x >= 0, fold, -fold), y - dr.select(y >= 0, fold, -fold), z)
    return n / dr.norm(n)
