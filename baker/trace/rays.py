"""Ray casting for the path tracer's kernels, through alpha-tested holes. Importing this starts Mitsuba."""

from typing import NamedTuple

from .mitsuba_scene import load_mitsuba
from .planes import ROUNDING

mi = load_mitsuba()

import drjit as dr  # noqa: E402  (needs the LLVM that load_mitsuba chose)

# A ray that leaves a surface starts at least this far off it, m: nothing is known of rays that start in a plane.
LEAST = 1e-9

# Rays that go on beyond a hit skip this share of the distance travelled and of the largest coordinate of their start.
SKIP = 2.0**-20

# Share of the distance to a light by which a shadow ray stops short of it: eight times float32's rounding. The light is
# off its own surface already, and a wall of 1 mm stands before a light that is up to 1 km away.
SHORT = 2.0**-20


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


def _beyond(tracer, o, t, prim, active):
    """Distance at which a ray from o goes on beyond its hit of triangle `prim` at distance t."""
    coordinate = dr.maximum(dr.maximum(dr.abs(o.x), dr.abs(o.y)), dr.abs(o.z))
    return t + dr.maximum(SKIP * (t + coordinate) + tracer.shading.plane(prim, active).y, LEAST)


def _ray(o, d, maxt):
    return mi.Ray3f(o, d, maxt, 0.0, mi.Color0f())


def closest(tracer, o, d, active):
    """Closest surface along a ray, seen through alpha-tested holes."""
    hit = Hit(mi.Float(dr.inf), mi.UInt32(0), mi.Point2f(0))
    if tracer.opaque is not None:
        found = tracer.opaque.ray_intersect_preliminary(_ray(o, d, mi.Float(dr.inf)), active=active)
        hit = Hit(dr.select(active & found.is_valid(), found.t, dr.inf), found.prim_index, found.prim_uv)
    return hit if tracer.masked is None else _closest_masked(tracer, o, d, hit, active)


@dr.syntax
def _closest_masked(tracer, o, d, hit, active):
    """The nearer of `hit` and the first alpha-tested surface that the ray meets outside a hole."""
    t, prim, b = mi.Float(hit.t), mi.UInt32(hit.prim), mi.Point2f(hit.b)
    start, searching = mi.Float(0), mi.Bool(active)
    while searching:
        found = tracer.masked.ray_intersect_preliminary(_ray(o + d * start, d, t - start), active=searching)
        meets = searching & found.is_valid()
        index, there = found.prim_index + tracer.opaque_count, start + found.t
        stops = meets & ~tracer.shading.hole(index, found.prim_uv, meets)
        t, prim = dr.select(stops, there, t), dr.select(stops, index, prim)
        b = dr.select(stops, found.prim_uv, b)
        start = _beyond(tracer, o, there, index, meets)
        searching = meets & ~stops
    return Hit(t, prim, b)


@dr.syntax
def closest_front(tracer, o, d, active):
    """What a camera sees: the closest surface, ignoring the backs of one-sided surfaces."""
    hit = closest(tracer, o, d, active)
    t, prim, b = hit.t, hit.prim, hit.b
    passing = active & _is_back(tracer, hit, d)
    while passing:
        start = _beyond(tracer, o, t, prim, passing)
        beyond = closest(tracer, o + d * start, d, passing)
        t, prim = dr.select(passing, start + beyond.t, t), dr.select(passing, beyond.prim, prim)
        b = dr.select(passing, beyond.b, b)
        passing = passing & _is_back(tracer, Hit(t, prim, b), d)
    return Hit(t, prim, b)


def _is_back(tracer, hit, d):
    found = dr.isfinite(hit.t)
    ng, material = tracer.shading.frame(hit.prim, found)
    return found & (dr.dot(ng, d) > 0) & ~tracer.shading.is_double_sided(material, found)


def unoccluded(tracer, origin, direction, distance, active):
    """Whether light reaches `origin` unblocked from `distance` (m) away along `direction`."""
    limit = distance * (1 - SHORT)
    free = mi.Bool(active)
    if tracer.opaque is not None:
        free = free & ~tracer.opaque.ray_test(_ray(origin, direction, limit), active=active)
    if tracer.masked is not None:
        hit = _closest_masked(tracer, origin, direction, Hit(limit, mi.UInt32(0), mi.Point2f(0)), free)
        free = free & ~(hit.t < limit)
    return free
