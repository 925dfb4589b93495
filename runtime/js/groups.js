/** Light groups of a .gsgi file; runtime/file/FORMAT.md is the specification. */
import { GROUP_BYTES, expect } from "./format.js";
import { openStreams } from "./integers.js";
import { readLight } from "./level.js";
import { BASE } from "./weights.js";

/** The group in the section from `begin` to `end`; `levels` are the records of both levels. */
export function decodeGroup(bytes, [begin, end], levels) {
    let at = begin + GROUP_BYTES;
    expect(at <= end, begin);
    const steps = bytes.subarray(begin, begin + 3), patterns = [];
    expect(steps.every((each) => each), begin);
    const text = (size) => {
        expect(at + size <= end, at);
        try {
            return new TextDecoder("utf-8", { fatal: true, ignoreBOM: true }).decode(bytes.subarray(at, at += size));
        } catch {
            expect(false, at);
        }
    };
    const name = text(bytes[begin + 3]);
    expect(name && !/\p{Cc}/u.test(name), begin);
    while (patterns.length < bytes[begin + 4]) {
        expect(at + 2 <= end, at);
        at += 2;
        patterns.push(text(bytes[at - 2] | bytes[at - 1] << 8));
    }
    expect((name === BASE) === !patterns.length, begin);
    const streams = openStreams(bytes, at, end);
    const [fine, coarse] = levels.map((record) => readLight(streams, record, steps, true));
    streams.finish();
    return { name, patterns, fine, coarse };
}
