/** Decodes .gsgi files; runtime/file/FORMAT.md is the specification. */
import {
    BLEND, COARSE, EFFECT_BITS, FINE, GAUSSIAN_COUNT_MAX, GROUPS_MOST, HEADER_BYTES, MAGIC, SECTION_BYTES, VERSION,
    expect,
} from "./format.js";
import { decodeGroup } from "./groups.js";
import { decodeLevel } from "./level.js";
import { decodeRelief } from "./relief.js";

export { FormatError } from "./format.js";

/**
 * The bake in the bytes of a .gsgi file, an ArrayBuffer or a view of one.
 *
 * The numbers are those of the Python reader, to the last bit of float32. The input may come from anywhere: what
 * FORMAT.md says must be refused is a FormatError, before anything is allocated by what it states. Which field it is
 * and what was expected there, `gsgi inspect` says.
 */
export function decode(data) {
    const bytes = new Uint8Array(data.buffer ?? data, data.byteOffset, data.byteLength);
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength), surface = bytes[12] === 1;
    const u16 = (byte) => view.getUint16(byte, true), u32 = (byte) => view.getUint32(byte, true);
    expect(bytes.length >= HEADER_BYTES && u32(0) === MAGIC, 0, "no .gsgi file");
    expect(u16(4) === VERSION, 4, `not version ${VERSION}`);
    expect(u16(6) === HEADER_BYTES && bytes[12] < 2 && !(u16(14) & ~EFFECT_BITS) && !u16(18), 6);
    const levels = [readLevel(bytes, view, FINE)];
    if (surface) levels.push(readLevel(bytes, view, COARSE));
    else expect(bytes.subarray(COARSE, HEADER_BYTES).every((each) => !each) && !levels[0].basis, FINE);
    let total = 0;
    for (const { count, degree } of levels) expect(degree <= 3 - surface && (total += count) <= GAUSSIAN_COUNT_MAX, FINE);
    const { FINE: fine, COAR: coarse, GRUP: groups, RELF: reliefs } = findSections(bytes, u32, levels.length);
    expect(u32(8) === crc32(bytes), 8);

    const toneScale = view.getFloat32(20, true), bake = {
        operator: surface ? "surface" : "over", effects: u16(14), bounces: u16(16), toneScale,
        scene: view.getBigUint64(24, true), blend: readBlend(bytes, surface), groups: [],
    };
    expect(toneScale > 0 && toneScale < Infinity, 20);
    bake.fine = decodeLevel(bytes, fine[0], levels[0]);
    bake.coarse = surface ? decodeLevel(bytes, coarse[0], levels[1]) : null;
    bake.fine.relief = reliefs[0] ? decodeRelief(bytes, reliefs[0], bake.fine) : null;
    for (const section of groups) {
        const group = decodeGroup(bytes, section, levels);
        expect(!bake.groups.some(({ name }) => name === group.name), section[0]);
        bake.groups.push(group);
    }
    return bake;
}

/** Where sections begin and end, by their tags: those of the levels, which come first, of light groups, and of relief. */
function findSections(bytes, u32, levels) {
    const found = { FINE: [], COAR: [], GRUP: [], RELF: [] }, first = ["FINE", "COAR"], surface = levels - 1;
    for (let at = HEADER_BYTES, number = 0; at < bytes.length; ++number) {
        const begin = at + SECTION_BYTES;
        expect(begin <= bytes.length, at);
        const tag = String.fromCharCode(...bytes.subarray(at, at + 4)), end = begin + u32(at + 4);
        expect(end <= bytes.length && (number >= levels || tag === first[number]), at);
        found[tag]?.push([begin, end]); // others are skipped
        at = end;
    }
    expect(found.FINE.length === 1 && found.COAR.length === surface &&
        found.GRUP.length <= GROUPS_MOST * surface && found.RELF.length <= surface, HEADER_BYTES);
    return found;
}

/** The operator's numbers, checked; those of the other operator are 0. */
function readBlend(bytes, surface) {
    const sharpness = bytes[13], numbers = new Float32Array(bytes.slice(BLEND, FINE).buffer);
    const [near, dilation, alphaMin, alphaMax, cutoff, floor] = numbers;
    expect(numbers.every((each) => each >= 0 && each < Infinity), BLEND);
    if (surface) {
        expect(!(near + dilation + alphaMin + alphaMax) &&
            cutoff && cutoff < 1 && floor >= 2 ** -126 && floor <= 1e6 && sharpness && sharpness <= 64, BLEND);
        return { sharpness, cutoff, floor };
    }
    expect(!(sharpness + cutoff + floor) && alphaMin && alphaMin < alphaMax && alphaMax < 1, BLEND);
    return { near, dilation, alphaMin, alphaMax };
}

/**
 * A level's record, checked: only the fine one may have slopes, bits (steps 0 and 3) are at most 16, other steps at least
 * 1. `low` is its position floor.
 */
function readLevel(bytes, view, byte) {
    const [degree, basis] = bytes.subarray(byte + 4), steps = bytes.subarray(byte + 8, byte + 16);
    const count = view.getUint32(byte, true), low = view.getInt16(byte + 6, true);
    expect(basis <= (byte < COARSE) && low >= -149 && low <= 104 &&
        steps.every((each, i) => i && i !== 3 ? each > 0 : each <= 16), byte);
    return { count, degree, basis, low, steps };
}

/** CRC-32 (zlib's) of a file whose own field for it counts as 0. */
function crc32(bytes) {
    const table = new Int32Array(256).map((_, crc) => {
        for (let bit = 8; bit--;) crc = crc >>> 1 ^ (crc & 1 && 0xedb88320);
        return crc;
    });
    let crc = ~0;
    for (let i = 0; i < bytes.length; ++i) crc = crc >>> 8 ^ table[(crc ^ (i >> 2 === 2 ? 0 : bytes[i])) & 255];
    return ~crc >>> 0;
}
