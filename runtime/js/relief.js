/** Relief of a .gsgi file: how light follows normal maps; runtime/file/FORMAT.md is the specification. */
import { SH_C0, Streams } from "./level.js";

const CODE_MAX = 127;
const f = Math.fround;

/** The relief, (N, 3, 3), of the Gaussians of the fine level in the section from `begin` to `end`. */
export function decodeRelief(bytes, { begin, end }, { count, shDegree, sh }, expect) {
    const steps = begin < end && bytes[begin], stride = 3 * (shDegree + 1) ** 2;
    expect(steps, begin, "relief");
    const streams = new Streams(bytes, begin + 1, end, "relief", expect);
    const green = streams.within("green", 3 * count, -CODE_MAX, CODE_MAX);
    const others = streams.read("red_blue", 6 * count);
    for (let i = 0; i < others.length; ++i) others[i] += green[i >> 1];
    streams.checkSteps(others, -CODE_MAX, CODE_MAX);
    streams.finish();
    const relief = new Float32Array(9 * count);
    for (let i = 0; i < green.length; ++i) {
        const first = stride * (i / 3 | 0), brightest = Math.max(0, ...sh.subarray(first, first + 3).map((c) => c * SH_C0));
        [others[2 * i], green[i], others[2 * i + 1]].forEach((code, c) => {
            relief[3 * i + c] = f(code / steps) * brightest;
        });
    }
    return relief;
}
