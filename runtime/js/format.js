/** The numbers of runtime/file/FORMAT.md, and what readers say of a file that does not follow it. */

export const MAGIC = 0x49475347; // "GSGI"
export const VERSION = 6;
export const HEADER_BYTES = 88;
export const BLEND = 32; // where the operator's numbers begin, and the records of the levels
export const FINE = 56;
export const COARSE = 72;
export const EFFECT_BITS = 0x3ff;
export const GAUSSIAN_COUNT_MAX = 0x1000000;
export const GROUPS_MOST = 255;
export const SECTION_BYTES = 8; // before what a section holds
export const GROUP_BYTES = 5; // before the name of a light group

export const SHIFT_BITS = 0x1f; // of the flags of a stream of integers
export const EXPONENTIAL = 0x20;
export const DELTA = 0x40;
export const SHIFT_MAX = 24;
export const FOLDED_BITS = 28;
export const MAGNITUDE_MAX = 0x4000000;

export const SCALE_OCTAVES = 57;
export const THIN = 4; // octaves between the longest axis and one that positions go by
export const LIGHT_OCTAVES_BELOW = 32;
export const LIGHT_OCTAVES_ABOVE = 16;
export const POSITION_MAX = 0xffffff; // of codes
export const SH_CODE_MAX = 0x100000;
export const SLOPE_CODE_MAX = 127;
export const RELIEF_CODE_MAX = 127;

/** A file that no encoder can have written; the message names the byte from which on it makes no sense. */
export class FormatError extends Error {
    name = "FormatError";
}

export function expect(condition, byte, what = "damaged") {
    if (!condition) throw new FormatError(`byte ${byte}: ${what}`);
}
