/** GLSL that reads B of a bake at any point of any shader, and the light in its textures: WebGL2, GLSL ES 3.00. */

import { HALF_MAX, LEVEL_TEXELS, LOOKUP, SH_C0 } from "./shaders.js";

export const HEADER_TEXELS = 2 * LEVEL_TEXELS + 2;

/** Numbers of SH coefficients of the fine and of the coarse level of a bake, and of texels with relief of the fine one. */
export function shCounts({ fine, coarse }) {
    return [(fine.shDegree + 1) ** 2, (coarse.shDegree + 1) ** 2, fine.relief ? 3 : 0];
}

/** Texels of a Gaussian. */
export function texelCount({ shDegree, relief }) {
    return 3 + (shDegree + 1) ** 2 + (relief ? 3 : 0);
}

/**
 * GLSL of `vec3 PREFIXindirect(vec3 position, vec3 normal)` for bakes with these counts, and of the same with
 * `vec3 mapped` behind, the normal as a normal map bends it. `PREFIXindirect_free(position, normal)` is for what was not
 * in the scene when it was baked, and moves: close to a baked surface the other has the light of that surface.
 *
 * Position (m) and normals, of any length, are in the world space of the bake. All names begin with `prefix`, so that
 * several bakes can be read in one shader. The uniforms are PREFIXgaussians, a sampler2D, PREFIXcells and PREFIXlists,
 * usampler2D: the textures of lookupTables().
 */
export function lookupSource(shCounts, prefix = "gsgi_") {
    return LOOKUP.replace(/\$\d/g, ([, number]) => shCounts[number] ?? 0).replaceAll("$", prefix);
}

/** Writes coefficients, slopes and relief into the texels of a level. */
export function writeLight(texels, level) {
    const { count, shDegree, sh, slope, relief } = level;
    const k = (shDegree + 1) ** 2, bound = HALF_MAX / SH_C0, stride = 4 * texelCount(level);
    for (let i = 0, at = 0; i < count; ++i, at += stride) {
        for (let j = 0; j < 3 * k; ++j)
            texels[at + 12 + j + (j / 3 | 0)] = clamp(sh[3 * k * i + j], bound);
        for (let j = 0; relief && j < 9; ++j)
            texels[at + 12 + 4 * k + j + (j / 3 | 0)] = clamp(relief[9 * i + j], HALF_MAX);
        if (slope) {
            texels[at + 11] = clamp(slope[2 * i], 1);
            texels[at + 15] = clamp(slope[2 * i + 1], 1);
        }
    }
}

/** Gives `tables`, which lookupTables() made of a bake, the light of one of the same shapes: see weighted(). */
export function recolour({ gaussians }, bake) {
    let at = 4 * HEADER_TEXELS;
    for (const level of [bake.fine, bake.coarse]) {
        const end = at + 4 * texelCount(level) * level.count;
        writeLight(gaussians.subarray(at, end), level);
        at = end;
    }
}

function clamp(x, bound) {
    return Math.min(Math.max(x, -bound), bound);
}
