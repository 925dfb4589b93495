"""Dr.Jit kernels of the path tracer. Imported inside the tracing stage only: importing it starts Mitsuba.

A surface is one-sided or two-sided; the back of a one-sided surface reflects and emits nothing, is invisible to camera
rays, and stops all other light. Alpha-tested holes stop nothing.
"""

import numpy as np

from .mitsuba_scene import ALPHA_HOLE, load_mitsuba

mi = load_mitsuba()

import drjit as dr  # noqa: E402  (needs the LLVM that load_mitsuba chose)

# Bounces end here: at albedo 0.75 the light cut off is below 1e-7. Russian roulette ends most paths far earlier.
BOUNCES_MAX = 64
ROULETTE_BOUNCE = 3
ROULETTE_MAX = 0.95


def first_hits(tracer, origin: np.ndarray, direction: np.ndarray) -> dict[str, np.ndarray]:
    """Surfaces that rays from `origin` (M, 3) along `direction` (M, 3) see: arrays (M, 3) float32 and `valid` (M,)."""
    ray = mi.Ray3f(mi.Point3f(origin.T), dr.normalize(mi.Vector3f(direction.T)))
    hit = _intersect(tracer, ray, mi.Bool(True), cull=True)
    valid = hit.is_valid()
    normal, geometric_normal = _facing_normals(hit)
    emission = hit.emitter(tracer.scene).eval(hit, valid) if tracer.emitters else mi.Color3f(0)
    albedo = hit.bsdf().eval_diffuse_reflectance(hit, valid)
    mask = np.array(valid).astype(bool)

    def rows(vector) -> np.ndarray:
        array = np.broadcast_to(np.array(vector).T, (len(direction), 3))
        return np.where(mask[:, None], array, 0).astype(np.float32)

    return {
        "position": rows(hit.p),
        "normal": rows(normal),
        "geometric_normal": rows(geometric_normal),
        "albedo": rows(albedo),
        "emission": rows(emission),
        "valid": mask,
    }


def mean_indirect(tracer, position, normal, geometric_normal, samples: int, seed: int) -> np.ndarray:
    """Mean over `samples` paths of the light arriving at each point, (N, 3) float64; arguments (N, 3) float32."""
    paths = len(position) * samples
    index = dr.arange(mi.UInt32, paths) // samples
    sampler = mi.load_dict({"type": "independent"})
    sampler.seed(seed, paths)
    p, n, ng = (dr.gather(mi.Point3f, mi.Point3f(a.T), index) for a in (position, normal, geometric_normal))
    light = _indirect(tracer, sampler, p, mi.Normal3f(n), mi.Normal3f(ng))
    return np.stack([np.array(dr.block_sum(c, samples), np.float64) for c in light], axis=-1) / samples


def direct(tracer, position, normal, geometric_normal) -> np.ndarray:
    """Light of all punctual lights at each point over pi, (N, 3) float32; arguments (N, 3) float32."""
    vertex = _vertex(mi.Point3f(position.T), mi.Normal3f(normal.T), mi.Normal3f(geometric_normal.T))
    active = dr.squared_norm(vertex.n) > 0
    result = mi.Color3f(0)
    for index in range(tracer.lights.count):
        # Opaque: one kernel serves all lights.
        result += _punctual(tracer, vertex, dr.opaque(mi.UInt32, index), active)
    return np.array(result).T


@dr.syntax
def _indirect(tracer, sampler, p, n, ng):
    """One path per lane: light that arrives at p, cosine-weighted, without the direct light of punctual lights."""
    active = dr.squared_norm(n) > 0
    throughput, result, bounce = mi.Color3f(1), mi.Color3f(0), mi.UInt32(0)
    while active:
        vertex = _vertex(p, n, ng)
        if tracer.lights.count > 0:
            index, weight = tracer.lights.sample(sampler.next_1d(active))
            result += throughput * weight * _punctual(tracer, vertex, index, active & (bounce > 0))
        if tracer.samples_emitters:
            result += throughput * _sample_emitter(tracer, sampler, vertex, active)

        # Follow a direction of the cosine lobe to the next surface.
        local = mi.warp.square_to_cosine_hemisphere(sampler.next_2d(active))
        ray = vertex.spawn_ray(vertex.to_world(local))
        active &= dr.dot(ray.d, ng) > 0
        hit = _intersect(tracer, ray, active, cull=False)
        active &= hit.is_valid()
        if tracer.emitters:
            pdf = local.z * dr.inv_pi
            light_pdf = mi.Float(0)
            if tracer.samples_emitters:
                sample = mi.DirectionSample3f(tracer.scene, hit, vertex)
                light_pdf = tracer.scene.pdf_emitter_direction(vertex, sample, active)
            emission = hit.emitter(tracer.scene).eval(hit, active)
            # pdf is 0 for a direction exactly in the tangent plane, and 0 / 0 would poison the pixel.
            result += dr.select(active & (pdf > 0), throughput * emission * pdf / (pdf + light_pdf), 0)
        throughput *= _reflectance(hit)
        n, ng = _facing_normals(hit)
        p = hit.p
        bounce += 1

        # Russian roulette (Arvo and Kirk 1990).
        survival = dr.select(bounce >= ROULETTE_BOUNCE, dr.minimum(dr.max(throughput), ROULETTE_MAX), 1)
        active &= (sampler.next_1d(active) < survival) & (bounce < BOUNCES_MAX)
        throughput *= dr.select(survival > 0, dr.rcp(survival), 0)
    return result


def _punctual(tracer, vertex, index, active):
    """Light of punctual light `index` that a white Lambertian surface at `vertex` would send on."""
    # `active = active & ...`: the augmented form would write into the caller's array.
    wi, distance, color = tracer.lights.arriving(index, vertex.p)
    cosine = dr.dot(wi, vertex.sh_frame.n)
    active = active & (cosine > 0) & (dr.dot(wi, vertex.n) > 0) & (dr.max(color) > 0)
    active = active & _unoccluded(tracer, vertex, wi, distance, active)
    return dr.select(active, color * cosine * dr.inv_pi, 0)


def _sample_emitter(tracer, sampler, vertex, active):
    """Light of one point of an emissive surface; multiple importance sampling against the cosine lobe (Veach 1997)."""
    sample, radiance = tracer.scene.sample_emitter_direction(vertex, sampler.next_2d(active), False, active)
    cosine = dr.dot(sample.d, vertex.sh_frame.n)
    active = active & (sample.pdf > 0) & (cosine > 0) & (dr.dot(sample.d, vertex.n) > 0)
    active = active & _unoccluded(tracer, vertex, sample.d, sample.dist, active)
    pdf = cosine * dr.inv_pi
    return dr.select(active, radiance * pdf / (1 + pdf / sample.pdf), 0)  # in this form sample.pdf may be infinite


def _vertex(p, n, ng):
    """Interaction at a point with shading normal `n` and geometric normal `ng`."""
    vertex = dr.zeros(mi.SurfaceInteraction3f)
    vertex.p, vertex.n, vertex.sh_frame = p, ng, mi.Frame3f(n)
    return vertex


def _facing_normals(hit):
    """Shading and geometric normal on the side that the ray came from."""
    ng = hit.n * hit.wi.z
    n = dr.select(dr.dot(hit.sh_frame.n, ng) < 0, -hit.sh_frame.n, hit.sh_frame.n)
    return n, ng


def _reflectance(hit):
    """Albedo of the side that was hit: 0 on the back of a one-sided surface."""
    bsdf = hit.bsdf()
    lit = dr.max(bsdf.eval(mi.BSDFContext(), hit, hit.wi)) > 0
    return dr.select(lit, bsdf.eval_diffuse_reflectance(hit), 0)


def _hit(tracer, ray, active):
    """Closest hit; its `wi` is +z or -z: the side of the true surface, whatever the interpolated normal says."""
    hit = tracer.scene.ray_intersect(ray, active)
    hit.wi = mi.Vector3f(0, 0, dr.select(dr.dot(hit.n, ray.d) > 0, -1, 1))
    return hit


def _passes(tracer, hit, cull: bool):
    """Whether a ray goes on through this hit: an alpha-tested hole or, with `cull`, the back of a one-sided surface."""
    passes = mi.Bool(False)
    if tracer.masks:
        passes |= hit.bsdf().eval_null_transmission(hit)[0] > 1 - ALPHA_HOLE
    if cull:
        passes |= (hit.wi.z < 0) & (dr.max(_reflectance(hit)) <= 0)
    return hit.is_valid() & passes


@dr.syntax
def _intersect(tracer, ray, active, cull):
    """Closest surface that the ray does not pass."""
    hit = _hit(tracer, ray, active)
    if tracer.masks or cull:
        passing = active & _passes(tracer, hit, cull)
        while passing:
            hit[passing] = _hit(tracer, hit.spawn_ray(ray.d), passing)
            passing &= _passes(tracer, hit, cull)
    return hit


@dr.syntax
def _unoccluded(tracer, vertex, direction, distance, active):
    """Whether nothing stops the light on its way to `vertex` from `distance` (m) away along `direction`."""
    ray = vertex.spawn_ray(direction)
    ray.maxt = distance * (1 - mi.math.ShadowEpsilon)
    if not tracer.masks:
        free = ~tracer.scene.ray_test(ray, active)
    else:
        hit = _hit(tracer, ray, active)
        passing = active & _passes(tracer, hit, False)
        while passing:
            ray.maxt[passing] -= hit.t
            ray.o[passing] = hit.spawn_ray(direction).o
            hit[passing] = _hit(tracer, ray, passing)
            passing &= _passes(tracer, hit, False)
        free = ~hit.is_valid()
    return free
