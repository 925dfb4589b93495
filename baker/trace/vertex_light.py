"""Light that comes to a vertex of a path straight from a light, in the path tracer's kernels.

That is one punctual light, a point on an emissive triangle, or a direction of the environment. Importing this starts
Mitsuba.
"""

from .mitsuba_scene import load_mitsuba
from .random_numbers import CANDIDATE, EMITTER, EMITTER_POINT, ENVIRONMENT, LIGHT, R2, TEXTURE
from .rays import lifted, transmitted, unoccluded

mi = load_mitsuba()

import drjit as dr  # noqa: E402  (needs the LLVM that load_mitsuba chose)

CANDIDATES = 3  # points on emitters, of which one is asked for light
_JITTER = {"base_color_texture": 0, "metallic_texture": 2, "emission_texture": 4}


def emitted_to_vertex(tracer, draws, cell, p, n, ng, bounce, lobe, active):
    """An estimate of the light at a vertex straight from emitters and the environment, over pi.

    The engine computes the direct light of punctual lights, so the point itself (bounce 0) gets none of it, but for
    what filtering surfaces let through where they cast shadows.
    """
    light = mi.Color3f(0)
    if tracer.lights.count > 0 and tracer.filtering is not None:
        light += chosen_punctual_light(tracer, draws, cell, p, n, ng, mi.Bool(False), active & (bounce == 0))
    if tracer.emitters.count > 0:
        light += _sample_emitter(tracer, draws, cell, p, n, ng, lobe, active)
    if tracer.environment is not None and tracer.environment.samples_light:
        light += _sample_environment(tracer, draws, p, n, ng, lobe, active)
    return light


def chosen_punctual_light(tracer, draws, cell, p, n, ng, active, filtered, places=None, reached=None):
    """The `punctual_light` of all lights, estimated by that of one.

    Where the vertex before is connected to lit `places` too, the vertex, as it was `reached`, does a share of the work.
    """
    index, probability = tracer.lights.choice.choose(draws.one(LIGHT), draws.rest(LIGHT), cell)
    share = mi.Float(1)
    if places is not None:
        connected = places.density(tracer.lights, index, p, ng, reached.cell, active)
        share = dr.select(reached.density > 0, balance(reached.density, connected), 0)
    return punctual_light(tracer, p, n, ng, index, active, filtered, share) / probability


def punctual_light(tracer, p, n, ng, index, active, filtered, share=1, dims=True):
    """Light of punctual light `index` that a white Lambertian surface at p would reflect.

    Its `share` counts: of light that is in no shadow where `active`, and of that in the shadow of filtering surfaces
    where `filtered`. With `dims`, surfaces that cast no shadow still dim light; without, they leave it as it is, as
    shadow maps do.
    """
    # Not `active &= ...`, which would modify the caller's array.
    wi, distance, color = tracer.lights.arriving(index, p)
    cosine = dr.dot(wi, n)
    faces = (cosine > 0) & (dr.dot(wi, ng) > 0) & (dr.max(color) > 0)
    if tracer.filtering is None:
        active = active & faces
        active = active & unoccluded(tracer, p, wi, distance, active)
        return dr.select(active, share * color * cosine * dr.inv_pi, 0)
    free = (active | filtered) & faces
    free = free & unoccluded(tracer, p, wi, distance, free)
    factor, _, shadowed = transmitted(tracer, p, wi, distance, free)
    counts = free & dr.select(shadowed, filtered, active)
    factor = factor if dims else mi.Color3f(1)
    return dr.select(counts, share * factor * color * cosine * dr.inv_pi, 0)


def _sample_emitter(tracer, draws, cell, p, n, ng, lobe, active):
    """Light of one of CANDIDATES points on a cluster of emissive triangles, the one that would bring most to the vertex
    being the likeliest if nothing were between (resampled importance sampling, Talbot et al. 2005).

    Half of a bulb faces away, and most of a tube is far away: a single point would often be asked in vain. Which
    cluster is in sight has been learned.
    """
    emitters, total, drawn = tracer.emitters, mi.Float(0), draws.independent(CANDIDATE).x
    index, at, probability, brings = mi.UInt32(0), mi.Point2f(0), mi.Float(1), mi.Float(1)
    cluster, u, likely = emitters.choice.choose_cluster(draws.one(EMITTER), draws.rest(EMITTER), cell)
    v = draws.two(EMITTER_POINT)
    for i in range(CANDIDATES):
        # Each has a part of the cluster to itself, and of the triangle another part than those before.
        one, within = emitters.choice.choose_within((u + i) * (1 / CANDIDATES), cluster)
        there = v + mi.Point2f(*(i * step * 2.0**-32 % 1 for step in R2))
        there -= dr.floor(there)
        point, prim, _, density, brightness = emitters.sample(one, there)
        offset = point - p
        squared = dr.squared_norm(offset)
        normal, material = tracer.shading.frame(prim, active)
        facing = -dr.dot(normal, offset)
        facing = dr.select(tracer.shading.is_double_sided(material, active), dr.abs(facing), facing)
        lights = active & (facing > 0) & (dr.dot(offset, n) > 0) & (dr.dot(offset, ng) > 0)
        would = dr.select(lights, brightness * facing * dr.dot(offset, n) / dr.square(squared), 0)
        weight = would / (density * within)
        total += weight
        share = dr.select(total > 0, weight / total, 0)
        takes = drawn < share
        drawn = dr.select(takes, drawn / share, (drawn - share) / (1 - share))
        index, at = dr.select(takes, one, index), dr.select(takes, there, at)
        probability, brings = dr.select(takes, within, probability), dr.select(takes, weight, brings)
    light = emitter_light(tracer, draws, index, at, likely * probability, p, n, ng, lobe, active & (total > 0))
    return light * (total / (CANDIDATES * brings))


def emitter_light(tracer, draws, index, at, probability, p, n, ng, lobe, active):
    """Light of the point `at` (Point2f in [0, 1)^2) on emissive triangle `index`, over the `probability` of both.

    Multiple importance sampling with the `lobe` (Veach 1997).
    """
    point, prim, b, density, _ = tracer.emitters.sample(index, at)
    density *= probability
    offset = point - p
    squared = dr.squared_norm(offset)
    distance = dr.sqrt(squared)
    wi = offset / distance
    cosine = dr.dot(wi, n)
    active = active & (cosine > 0) & (dr.dot(wi, ng) > 0) & (squared > 0)
    front_ng, material = tracer.shading.frame(prim, active)
    facing = -dr.dot(front_ng, wi)
    active &= (facing > 0) | (tracer.shading.is_double_sided(material, active) & (facing != 0))
    if tracer.masked is not None:  # a filter's holes cover nothing
        active &= ~tracer.shading.hole(prim, b, active)
    side_ng = dr.select(facing > 0, front_ng, -front_ng)
    towards = lifted(tracer, point, side_ng, prim, active) - p
    reach = dr.norm(towards)
    active &= unoccluded(tracer, p, towards / reach, reach, active)
    radiance = tracer.shading.emission(material, prim, b, active, jitter_of(draws))
    if tracer.filtering is not None:
        radiance *= transmitted(tracer, p, towards / reach, reach, active)[0]
        own = tracer.shading.is_filter(material, active)
        radiance *= dr.select(own, tracer.shading.filtered(prim, b, own)[1], 1)
    light_pdf = density * squared / dr.abs(facing)
    by_cosine = cosine * dr.inv_pi
    return dr.select(active, radiance * by_cosine / (light_pdf + by_cosine * lobe.ratio(wi, active)), 0)


def _sample_environment(tracer, draws, p, n, ng, lobe, active):
    """Light from one direction of the environment, sampled in proportion to its radiance."""
    wi, radiance, density = tracer.environment.sample(draws.two(ENVIRONMENT))
    cosine = dr.dot(wi, n)
    active = active & (cosine > 0) & (dr.dot(wi, ng) > 0) & (density > 0)
    active = active & unoccluded(tracer, p, wi, mi.Float(dr.inf), active)
    if tracer.filtering is not None:
        radiance = radiance * transmitted(tracer, p, wi, mi.Float(dr.inf), active)[0]
    by_cosine = cosine * dr.inv_pi
    return dr.select(active, radiance * by_cosine / (density + by_cosine * lobe.ratio(wi, active)), 0)


def reflects(tracer, material, front, active):
    """Whether a surface of this material reflects light on the side that is its front or not."""
    sided = front | tracer.shading.is_double_sided(material, active)
    return active & sided & ~is_unlit(tracer, material, active)


def is_unlit(tracer, material, active):
    """Whether a surface of this material reflects nothing, as it is unlit."""
    if not tracer.unlit:
        return mi.Bool(False)
    return dr.gather(mi.Vector4f, tracer.shading.emission_table, material, active).w > 0


def jitter_of(draws):
    """A function from the name of a kind of texture to the random offset (Point2f) that picks its texel."""
    return lambda name: draws.independent(TEXTURE + _JITTER[name])


def balance(pdf, other):
    """Weight of the balance heuristic (Veach 1997); also correct for an infinite `other`."""
    return dr.rcp(1 + other / pdf)
