/** Light groups of a .gsgi file; runtime/file/FORMAT.md is the specification. */
import { Streams } from "./level.js";
import { BASE } from "./weights.js";

const HEAD_BYTES = 5;

/** The group in the section from `begin` to `end`; `levels` are the records of both levels. */
export function decodeGroup(bytes, { begin, end }, levels, expect) {
    let at = begin + HEAD_BYTES;
    expect(at <= end, begin, "group");
    const [lightSteps, shSteps, slopeSteps, nameBytes, count] = bytes.subarray(begin, at);
    expect(lightSteps && shSteps && slopeSteps, begin, "group");
    const text = (field, size) => {
        expect(at + size <= end, at, field);
        try {
            const options = { fatal: true, ignoreBOM: true };
            return new TextDecoder("utf-8", options).decode(bytes.subarray(at, at += size));
        } catch {
            expect(false, at, field);
        }
    };
    const name = text("group.name", nameBytes), patterns = [];
    expect(name && !/[^\P{C}]|[^\P{Z} ]/u.test(name), begin, "group.name");
    for (let i = 0; i < count; ++i) {
        expect(at + 2 <= end, at, "group.pattern");
        at += 2;
        patterns.push(text("group.pattern", bytes[at - 2] | bytes[at - 1] << 8));
    }
    expect((name === BASE) === !count, begin, "group.pattern_count");
    const streams = new Streams(bytes, at, end, "group", expect);
    const [fine, coarse] = levels.map((level) => streams.light({ ...level, lightSteps, shSteps, slopeSteps }));
    streams.finish();
    return { name, patterns, fine, coarse };
}
