/** GLSL that reads B of a bake at any point of any shader, and the light in its textures: WebGL2, GLSL ES 3.00. */

import { HALF_MAX, LEVEL_TEXELS, LOOKUP, SH_C0 } from "./shaders.js";

export const HEADER_TEXELS = 2 * LEVEL_TEXELS + 2;

/** Numbers of SH coefficients of the fine and of the coarse level of a bake. */
export function shCounts(bake) {
    return [bake.fine, bake.coarse].map((level) => (level.shDegree + 1) ** 2);
}

/**
 * GLSL of `vec3 PREFIXindirect(vec3 position, vec3 normal)` for bakes with these numbers of SH coefficients.
 *
 * Position (m) and normal, of any length, are in the world space of the bake. All names begin with `prefix`, so that
 * several bakes can be read in one shader. The uniforms are PREFIXgaussians, a sampler2D, PREFIXcells and PREFIXlists,
 * usampler2D: the textures of lookupTables().
 */
export function lookupSource([fine, coarse], prefix = "gsgi_") {
    const defines = `#define $FINE_SH_COUNT ${fine}\n#define $COARSE_SH_COUNT ${coarse}\n`;
    return (defines + LOOKUP).replaceAll("$", prefix);
}

/** Writes coefficients and slopes into the texels of a level. */
export function writeLight(texels, { count, shDegree, sh, slope }) {
    const k = (shDegree + 1) ** 2, bound = HALF_MAX / SH_C0;
    for (let i = 0, at = 0; i < count; ++i, at += 4 * (3 + k)) {
        for (let j = 0; j < 3 * k; ++j)
            texels[at + 12 + j + (j / 3 | 0)] = clamp(sh[3 * k * i + j], bound);
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
        const end = at + 4 * (3 + (level.shDegree + 1) ** 2) * level.count;
        writeLight(gaussians.subarray(at, end), level);
        at = end;
    }
}

function clamp(x, bound) {
    return Math.min(Math.max(x, -bound), bound);
}
