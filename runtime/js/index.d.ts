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
    /**
     * (N, 3, 3): change of the light per unit of the mapped normal minus the interpolated one, along each axis of the
     * world (first 3) and for each channel; null for light that does not follow normal maps, and on the coarse level
     */
    relief?: Float32Array | null;
}

/** The part of a bake's light that comes from some of the scene's lights: other colours of the same Gaussians. */
export interface LightGroup {
    /** "base" for all lights that are in no other group. */
    name: string;
    /** What the names of its lights match: `*`, `?`, `[abc]`. */
    patterns: string[];
    fine: Pick<Gaussians, "sh" | "slope">;
    coarse: Pick<Gaussians, "sh" | "slope">;
}

/** Factors on the light of light groups, by name: a number, or three of linear Rec.709. 1 for those left out. */
export type Weights = Record<string, number | Iterable<number>>;

interface Header {
    /** A sum of the bits of FORMAT.md, section Effects. */
    effects: number;
    bounces: number;
    toneScale: number;
    /** Fingerprint of the scene; 0 is unknown. */
    scene: bigint;
    fine: Gaussians;
    /** Empty for a bake whose lights were not baked apart. */
    groups: LightGroup[];
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

/** A file that no encoder can have written; the message names the byte from which on it makes no sense. */
export class FormatError extends Error {}

/** The bake in the bytes of a .gsgi file. Throws FormatError. */
export function decode(data: ArrayBuffer | ArrayBufferView): Bake;

/** The names that weights of a bake may have, "base" first; none without groups. */
export function groupNames(bake: Bake): string[];

/**
 * The bake with the light of each of its groups multiplied by its weight; with ones the bake itself. Throws RangeError
 * for an unknown group, which lists the known ones, and for weights that are not from 0 to 1e15.
 */
export function weighted<B extends Bake>(bake: B, weights: Weights): B;

/** Numbers of SH coefficients of the fine and of the coarse level of a bake, and of texels with relief: 3 or 0. */
export function shCounts(bake: SurfaceBake): [fine: number, coarse: number, relief: number];

/**
 * GLSL ES 3.00 of `vec3 PREFIXindirect(vec3 position, vec3 normal)` for bakes with these counts, and of the same with
 * `vec3 mapped` behind: the normal as a normal map bends it, which the light follows where the file says how.
 * `PREFIXindirect_free(position, normal)` is for what was not in the scene when it was baked, and moves. Its uniforms
 * are PREFIXgaussians (sampler2D), PREFIXcells and PREFIXlists (usampler2D). The prefix is "gsgi_" unless it is given.
 */
export function lookupSource(shCounts: [fine: number, coarse: number, relief?: number], prefix?: string): string;

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

/**
 * Gives tables that lookupTables() made of a bake the light of one of the same shapes, such as weighted() returns: their
 * `gaussians` change, and are to be uploaded again.
 */
export function recolour(tables: LookupTables, bake: SurfaceBake): void;
