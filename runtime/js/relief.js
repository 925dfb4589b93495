/** Relief of a .gsgi file: how light follows normal maps; runtime/file/FORMAT.md is the specification. */
import { RELIEF_CODE_MAX, expect } from "./format.js";
import { openStreams } from "./integers.js";
import { SH_C0 } from "./level.js";

/** The relief, (N, 3, 3), of the Gaussians of the fine level in the section from `begin` to `end`. */
export function decodeRelief(bytes, [begin, end], { count, shDegree, sh }) {
    const steps = begin < end && bytes[begin], stride = 3 * (shDegree + 1) ** 2;
    expect(steps, begin);
    const streams = openStreams(bytes, begin + 1, end), codes = streams.colours(3 * count, RELIEF_CODE_MAX);
    streams.finish();
    return Float32Array.from(codes, (code, i) => {
        const first = stride * (i / 9 | 0);
        const brightest = Math.max(...sh.subarray(first, first + 3));
        return Math.fround(code / steps) * Math.fround(brightest * SH_C0);
    });
}
