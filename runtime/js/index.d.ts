/** N Gaussians in world space, as flat arrays; units and meaning as in runtime/gaussians.py. */
export interface Gaussians {
    count: number;
    shDegree: number;
    /** (N, 3), m */
    position: Float32Array;
    /** (N, 4), unit quaternion xyzw */
    rotation: Float32Array;
    /** (N, 3), standard deviation along each axis, m */
    scale: Float32Array;
    /** (N), 0 to 1 */
    opacity: Float32Array;
    /** (N, K, 3), K = (shDegree + 1)^2 coefficients of linear Rec.709 light */
    sh: Float32Array;
    /** (N, 2), or null for light that is the same all over a Gaussian */
    slope: Float32Array | null;
}

interface Header {
    /** A sum of the bits of FORMAT.md, section Effects. */
    effects: number;
    bounces: number;
    toneScale: number;
    /** Fingerprint of the scene; 0 is unknown. */
    scene: bigint;
    fine: Gaussians;
}

export interface SurfaceBake extends Header {
    operator: "surface";
    blend: { sharpness: number; cutoff: number; floor: number };
    coarse: Gaussians;
}

export interface OverBake extends Header {
    operator: "over";
    blend: { near: number; dilation: number; alphaMin: number; alphaMax: number };
    coarse: null;
}

/** The content of a .gsgi file. */
export type Bake = SurfaceBake | OverBake;

/** A file that no encoder can have written; the message names byte and field. */
export class FormatError extends Error {}

/** The bake in the bytes of a .gsgi file. Throws FormatError. */
export function decode(data: ArrayBuffer | ArrayBufferView): Bake;

/** Numbers of SH coefficients of the fine and of the coarse level of a bake. */
export function shCounts(bake: SurfaceBake): [fine: number, coarse: number];

/**
 * GLSL ES 3.00 of `vec3 PREFIXindirect(vec3 position, vec3 normal)` for bakes with these numbers of SH coefficients.
 * Its uniforms are PREFIXgaussians (sampler2D), PREFIXcells and PREFIXlists (usampler2D). The prefix is "gsgi_" unless
 * it is given.
 */
export function lookupSource(shCounts: [fine: number, coarse: number], prefix?: string): string;

/** Texels for lookupSource(), in rows of `width`: for RGBA32F, R32UI, and R16UI or R32UI. */
export interface LookupTables {
    width: number;
    gaussians: Float32Array;
    cells: Uint32Array;
    lists: Uint16Array | Uint32Array;
}

/**
 * What lookupSource() reads of a bake. `maxSize`, 2048 unless given, is the most rows of a texture. Throws RangeError
 * for the operator `over`, and for more Gaussians than textures of that size hold.
 */
export function lookupTables(bake: Bake, maxSize?: number): LookupTables;
