"""Ray casting for the path tracer's kernels, through alpha-tested holes and what lets light through in part.

A path meets a surface that filters light with the probability that the light does not pass it in its strongest channel
(stochastic transparency, Enderton et al. 2010), and shadow rays multiply what the surfaces on their way transmit.
Importing this starts Mitsuba.
"""

from typing import NamedTuple

from gsgi.runtime.constants import ALPHA_MIN
from gsgi.runtime.scene import CUTOFF

from .mitsuba_scene import load_mitsuba
from .planes import ROUNDING
from .surface_tables import FILTERING, MASKED, OPAQUE

mi = load_mitsuba()

import drjit as dr  # noqa: E402  (needs the LLVM that load_mitsuba chose)

# A ray that leaves a surface starts at least this far off it, m: nothing is known of rays that start in a plane.
LEAST = 1e-9

# Rays that go on beyond a hit skip this share of the distance travelled and of the largest coordinate of their start.
SKIP = 2.0**-20

GRAZING = 2.0**-12  # cosine with a normal, below which a ray counts as no nearer to the plane

# Share of the distance to a light by which a shadow ray stops short of it: eight times float32's rounding. The light is
# off its own surface already, and a wall of 1 mm stands before a light that is up to 1 km away.
SHORT = 2.0**-20

# Most filtering surfaces that light passes on its way: the next one stops it.
LAYERS = 256


class Hit(NamedTuple):
    """Where a ray ends: distance t (infinite: no hit), triangle, barycentric coordinates of its corners 1 and 2."""

    t: "mi.Float"
    prim: "mi.UInt32"
    b: "mi.Point2f"


def side(tracer, hit, d, active):
    """Geometric normal on the side that a ray along `d` hits, the material, and whether that side is the front."""
    ng, material = tracer.shading.frame(hit.prim, active)
    front = dr.dot(ng, d) < 0
    return dr.select(front, ng, -ng), material, front


def lifted(tracer, p, ng, prim, active):
    """The start of rays that leave triangle `prim` at p, on the side of `ng`."""
    height = _rounding(p, ng) + tracer.shading.plane(prim, active).y
    return mi.Point3f(p + ng * dr.maximum(height, LEAST))


def lifted_hit(tracer, o, d, hit, ng, front, active):
    """The same for the point where the ray o + t d hits: on the side of `ng`, which is the front or not.

    The point is first moved along `ng` into the triangle's plane, which it misses by the error of the distance t.
    """
    p = mi.Point3f(o + d * dr.select(active, hit.t, 0))
    offset = tracer.shading.plane(hit.prim, active).x
    above = dr.dot(ng, p) - dr.select(front, offset, -offset)
    return lifted(tracer, p - ng * dr.select(active, above, 0), ng, hit.prim, active)


def lifted_point(tracer, p, ng, active):
    """The same for a point p on a triangle that is not known, or in free space.

    The triangle is looked for along the normal, as far off as the least accurate triangle of the scene can be. Where
    triangles were moved, the point moves along with its own.
    """
    reach = 2 * (_rounding(p, ng) + tracer.shading.inaccuracy) + LEAST
    start = mi.Point3f(p + ng * reach)
    hit = closest(tracer, start, -ng, active)
    near = active & (hit.t < 2 * reach)
    if not tracer.shading.moved:
        return lifted(tracer, p, ng, hit.prim, near)
    found_ng, _, front = side(tracer, hit, -ng, near)
    there = lifted_hit(tracer, start, -ng, hit, found_ng, front, near)
    return dr.select(near, there, lifted(tracer, p, ng, hit.prim, near))


def _rounding(p, n):
    """Bound on the error by which rounding moves p along a unit normal, m."""
    return ROUNDING * (dr.abs(p.x * n.x) + dr.abs(p.y * n.y) + dr.abs(p.z * n.z))


def beyond(tracer, o, d, t, prim, active):
    """Distance at which a ray from o along d goes on beyond its hit of triangle `prim` at distance t.

    What it misses the plane by counts as far as it follows the plane, so that it does not meet the triangle again.
    """
    coordinate = dr.maximum(dr.maximum(dr.abs(o.x), dr.abs(o.y)), dr.abs(o.z))
    ng, _ = tracer.shading.frame(prim, active)
    off = _rounding(o, ng) + tracer.shading.plane(prim, active).y
    steep = dr.maximum(dr.abs(dr.dot(ng, d)), GRAZING)
    return t + dr.maximum(SKIP * (t + coordinate) + off / steep, LEAST)


def _ray(o, d, maxt):
    return mi.Ray3f(o, d, maxt, 0.0, mi.Color0f())


def closest(tracer, o, d, active, least=ALPHA_MIN):
    """Closest surface along a ray, seen through alpha-tested holes.

    Of surfaces that filter light those count from which at least the share `least` of the light comes.
    """
    hit = closest_blocking(tracer, o, d, active)
    return hit if tracer.filtering is None else _through_filters(tracer, o, d, hit, None, least, active)[0]


def closest_through(tracer, o, d, u, active):
    """The surface that a path meets, decided by the random number `u` in [0, 1), and a factor (Color3f) on light.

    The factor multiplies what the surface reflects and emits, or the light from beyond the scene.
    """
    hit = closest_blocking(tracer, o, d, active)
    return (hit, mi.Color3f(1)) if tracer.filtering is None else _through_filters(tracer, o, d, hit, u, 0.0, active)


def closest_blocking(tracer, o, d, active):
    """Closest surface along a ray that lets no light through, seen through alpha-tested holes."""
    hit = Hit(mi.Float(dr.inf), mi.UInt32(0), mi.Point2f(0))
    if tracer.opaque is not None:
        found = tracer.opaque.ray_intersect_preliminary(_ray(o, d, mi.Float(dr.inf)), active=active)
        prim = tracer.places.triangle(OPAQUE, found)
        hit = Hit(dr.select(active & found.is_valid(), found.t, dr.inf), prim, found.prim_uv)
    return hit if tracer.masked is None else _closest_masked(tracer, o, d, hit, active)


@dr.syntax
def _closest_masked(tracer, o, d, hit, active):
    """The nearer of `hit` and the first alpha-tested surface that the ray meets outside a hole."""
    t, prim, b = mi.Float(hit.t), mi.UInt32(hit.prim), mi.Point2f(hit.b)
    start, searching = mi.Float(0), mi.Bool(active)
    while searching:
        found = tracer.masked.ray_intersect_preliminary(_ray(o + d * start, d, t - start), active=searching)
        meets = searching & found.is_valid()
        index, there = tracer.places.triangle(MASKED, found), start + found.t
        stops = meets & ~tracer.shading.hole(index, found.prim_uv, meets)
        t, prim = dr.select(stops, there, t), dr.select(stops, index, prim)
        b = dr.select(stops, found.prim_uv, b)
        start = beyond(tracer, o, d, there, index, meets)
        searching = meets & ~stops
    return Hit(t, prim, b)


@dr.syntax
def _through_filters(tracer, o, d, hit, u, least, active):
    """The nearer of `hit` and the first filtering surface at which the ray ends, and the factor on light from there.

    Without `u` it ends where at least the share `least` of the light comes from the surface, and the factor means
    nothing.
    """
    t, prim, b = mi.Float(hit.t), mi.UInt32(hit.prim), mi.Point2f(hit.b)
    start, searching, factor = mi.Float(0), mi.Bool(active), mi.Color3f(1)
    left, layers = mi.Float(0 if u is None else u), mi.UInt32(0)
    while searching:
        found = tracer.filtering.ray_intersect_preliminary(_ray(o + d * start, d, t - start), active=searching)
        meets = searching & found.is_valid()
        index, there = tracer.places.triangle(FILTERING, found), start + found.t
        through, share, *_ = tracer.shading.filtered(index, found.prim_uv, meets)
        chance = mi.Float(-1) if u is None else dr.max(through)
        stops = meets & ((share >= least) if u is None else _ends(left, chance, layers))
        passes = meets & ~stops
        # A surface uses up the part of the random number that it decided with, and the rest is as random as it was.
        left = dr.select(passes, dr.minimum(left / chance, 1 - 2.0**-24), left)
        factor *= dr.select(passes, through / chance, 1)
        factor *= dr.select(stops, dr.select(chance < 1, share / (1 - chance), 0), 1)
        t, prim = dr.select(stops, there, t), dr.select(stops, index, prim)
        b = dr.select(stops, found.prim_uv, b)
        start = beyond(tracer, o, d, there, index, meets)
        layers += 1
        searching = meets & ~stops
    return Hit(t, prim, b), factor


def _ends(left, chance, layers):
    """Whether a path with this random number left ends at a surface that it passes with this chance."""
    return ((left >= chance) & (chance < 1)) | (layers >= LAYERS)


@dr.syntax
def closest_front(tracer, o, d, active, u=None):
    """What a camera sees: the closest surface, ignoring the backs of one-sided surfaces and what is mostly clear.

    With random numbers `u` in [0, 1) it sees what lets light through as often as a path meets it.
    """
    hit = _seen(tracer, o, d, u, active)
    t, prim, b = hit.t, hit.prim, hit.b
    passing = active & _is_back(tracer, hit, d)
    while passing:
        start = beyond(tracer, o, d, t, prim, passing)
        next_hit = _seen(tracer, o + d * start, d, u, passing)
        t, prim = dr.select(passing, start + next_hit.t, t), dr.select(passing, next_hit.prim, prim)
        b = dr.select(passing, next_hit.b, b)
        passing = passing & _is_back(tracer, Hit(t, prim, b), d)
    return Hit(t, prim, b)


def _seen(tracer, o, d, u, active):
    """What `closest_front` sees, backs too."""
    return closest(tracer, o, d, active, CUTOFF) if u is None else closest_through(tracer, o, d, u, active)[0]


def _is_back(tracer, hit, d):
    found = dr.isfinite(hit.t)
    ng, material = tracer.shading.frame(hit.prim, found)
    return found & (dr.dot(ng, d) > 0) & ~tracer.shading.is_double_sided(material, found)


def unoccluded(tracer, origin, direction, distance, active):
    """Whether light reaches `origin` from `distance` (m) away along `direction`, past no surface or through filters."""
    limit = distance * (1 - SHORT)
    free = mi.Bool(active)
    if tracer.opaque is not None:
        free = free & ~tracer.opaque.ray_test(_ray(origin, direction, limit), active=active)
    if tracer.masked is not None:
        hit = _closest_masked(tracer, origin, direction, Hit(limit, mi.UInt32(0), mi.Point2f(0)), free)
        free = free & ~(hit.t < limit)
    return free


@dr.syntax
def transmitted(tracer, origin, direction, distance, active):
    """What filtering surfaces leave (Color3f) of such light, whether it passes any of them outside its holes, and
    whether one of these casts a shadow."""
    factor, filtered, shadowed = mi.Color3f(1), mi.Bool(False), mi.Bool(False)
    limit = distance * (1 - SHORT)
    start, searching, layers = mi.Float(0), mi.Bool(active), mi.UInt32(0)
    while searching:
        ray = _ray(origin + direction * start, direction, limit - start)
        found = tracer.filtering.ray_intersect_preliminary(ray, active=searching)
        meets = searching & found.is_valid()
        index = tracer.places.triangle(FILTERING, found)
        through, _, there, casts = tracer.shading.filtered(index, found.prim_uv, meets)
        factor *= dr.select(meets, dr.select(layers < LAYERS, through, 0), 1)
        filtered |= there
        shadowed |= casts
        start = beyond(tracer, origin, direction, start + found.t, index, meets)
        layers += 1
        searching = meets & (dr.max(factor) > 0)
    return factor, filtered, shadowed
