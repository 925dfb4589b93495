/** Decodes .gsgi files; runtime/file/FORMAT.md is the specification. */
import { decodeGroup } from "./groups.js";
import { decodeLevel, leastBytes } from "./level.js";
import { decodeRelief } from "./relief.js";

const MAGIC = 0x49475347; // "GSGI"
const VERSION = 5;
const HEADER_BYTES = 88, SECTION_BYTES = 8;
const FINE = 56, COARSE = 72; // where the records of the levels begin
const EFFECT_BITS = 0x1ff;
const GAUSSIAN_COUNT_MAX = 1 << 24, GROUPS_MOST = 255;

/** A file that no encoder can have written; the message names byte and field. */
export class FormatError extends Error {
    name = "FormatError";
}

function expect(condition, byte, field) {
    if (!condition) throw new FormatError(`byte ${byte} (${field}): damaged, or of another version`);
}

/**
 * The bake in the bytes of a .gsgi file, an ArrayBuffer or a view of one.
 *
 * The numbers are those of the Python reader, to the last bit of float32. The input may come from anywhere: what
 * FORMAT.md says must be refused is a FormatError, before anything is allocated by what it states. What was expected
 * there, `gsgi inspect` says.
 */
export function decode(data) {
    const bytes = ArrayBuffer.isView(data)
        ? new Uint8Array(data.buffer, data.byteOffset, data.byteLength) : new Uint8Array(data);
    expect(bytes.length >= HEADER_BYTES, bytes.length, "header");
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength), operator = bytes[12];
    expect(view.getUint32(0, true) === MAGIC, 0, "magic");
    expect(view.getUint16(4, true) === VERSION, 4, "version");
    expect(view.getUint16(6, true) === HEADER_BYTES, 6, "header_bytes");
    expect(operator < 2, 12, "operator");
    const levels = [readLevel(view, FINE, "fine", 3 - operator), readLevel(view, COARSE, "coarse", 3 - operator)];
    expect(levels[0].count + levels[1].count <= GAUSSIAN_COUNT_MAX, COARSE, "coarse.gaussian_count");
    const used = operator ? levels : levels.slice(0, 1), { sections, groups, relief } = findSections(view, used);
    expect(view.getUint32(8, true) === crc32(bytes), 8, "crc32");

    const bake = readHeader(view, levels);
    [bake.fine, bake.coarse = null] = sections.map((section, i) => decodeLevel(bytes, section, levels[i], expect));
    bake.fine.relief = relief && decodeRelief(bytes, relief, bake.fine, expect);
    bake.groups = [];
    for (const section of groups) {
        expect(bake.groups.length < GROUPS_MOST, section.begin, "group");
        const group = decodeGroup(bytes, section, levels, expect);
        expect(!bake.groups.some(({ name }) => name === group.name), section.begin, "group.name");
        bake.groups.push(group);
    }
    return bake;
}

/** Where sections begin and end: of these levels, which come first, of light groups, and of relief. Others are skipped. */
function findSections(view, levels) {
    const sections = [], groups = [], tags = ["FINE", "COAR"];
    let relief = null;
    for (let at = HEADER_BYTES; at < view.byteLength || sections.length < levels.length;) {
        const begin = at + SECTION_BYTES, level = levels[sections.length], name = level?.name ?? "section";
        expect(begin <= view.byteLength, view.byteLength, name);
        const tag = String.fromCharCode(...[0, 1, 2, 3].map((i) => view.getUint8(at + i)));
        const end = begin + view.getUint32(at + 4, true);
        if (level) expect(tag === tags[sections.length] && end - begin >= leastBytes(level), at, name);
        else expect(!tags.includes(tag), at, name);
        expect(end <= view.byteLength, view.byteLength, name);
        if (tag === "GRUP" || tag === "RELF") expect(levels[1] && !(relief && tag === "RELF"), at, name);
        if (tag === "RELF") relief = { begin, end };
        if (level) sections.push({ begin, end });
        if (tag === "GRUP") groups.push({ begin, end });
        at = end;
    }
    return { sections, groups, relief };
}

/** The header's fields, checked, but for the levels. */
function readHeader(view, levels) {
    const number = (byte, field) => {
        const value = view.getFloat32(byte, true);
        expect(Number.isFinite(value), byte, field);
        return value;
    };
    const surface = view.getUint8(12) === 1, sharpness = view.getUint8(13), effects = view.getUint16(14, true);
    const toneScale = number(20, "tone_scale");
    expect((effects & ~EFFECT_BITS) === 0, 14, "effects");
    expect(view.getUint16(18, true) === 0, 18, "reserved");
    expect(toneScale > 0, 20, "tone_scale");
    const [near, dilation, alphaMin, alphaMax, cutoff, floor] =
        ["near", "dilation", "alpha_min", "alpha_max", "cutoff", "floor"].map((field, i) => number(32 + 4 * i, field));
    if (surface) {
        expect(near === 0 && dilation === 0 && alphaMin === 0 && alphaMax === 0, 32, "near");
        expect(0 < cutoff && cutoff < 1, 48, "cutoff");
        expect(0 < floor && floor <= 1e6, 52, "floor");
        expect(1 <= sharpness && sharpness <= 64, 13, "sharpness");
    } else {
        expect(sharpness === 0 && cutoff === 0 && floor === 0, 13, "sharpness");
        expect(near >= 0, 32, "near");
        expect(dilation >= 0, 36, "dilation");
        expect(0 < alphaMin && alphaMin < alphaMax && alphaMax < 1, 40, "alpha_min");
        expect(levels[0].basis === 0, FINE + 5, "fine.basis");
        for (let byte = COARSE; byte < HEADER_BYTES; ++byte) expect(view.getUint8(byte) === 0, byte, "coarse");
    }
    for (const level of surface ? levels : levels.slice(0, 1)) checkLevel(level);
    return {
        operator: surface ? "surface" : "over", effects, bounces: view.getUint16(16, true), toneScale,
        scene: view.getBigUint64(24, true),
        blend: surface ? { sharpness, cutoff, floor } : { near, dilation, alphaMin, alphaMax },
    };
}

/** A level's record; what the length of its section follows from is checked. */
function readLevel(view, byte, name, highest) {
    const numbers = Array.from({ length: 8 }, (_, i) => view.getUint8(byte + 8 + i));
    const [positionBits, scaleSteps, normalSteps, angleBits, opacitySteps, lightSteps, shSteps, slopeSteps] = numbers;
    const level = {
        byte, name, numbers,
        count: view.getUint32(byte, true), degree: view.getUint8(byte + 4), basis: view.getUint8(byte + 5),
        positionFloor: view.getInt16(byte + 6, true),
        positionBits, scaleSteps, normalSteps, angleBits, opacitySteps, lightSteps, shSteps, slopeSteps,
    };
    expect(level.count <= GAUSSIAN_COUNT_MAX, byte, `${name}.gaussian_count`);
    expect(level.degree <= highest, byte + 4, `${name}.sh_degree`);
    expect(level.basis <= 1, byte + 5, `${name}.basis`);
    return level;
}

/** Bits (at 0 and 3) are at most 16, steps at least 1. */
function checkLevel({ byte, name, positionFloor, numbers }) {
    expect(positionFloor >= -149 && positionFloor <= 104, byte + 6, `${name}.position_floor`);
    numbers.forEach((each, i) => expect(i % 3 === 0 && i < 4 ? each <= 16 : each > 0, byte + 8 + i, `${name} steps`));
}

/** CRC-32 (zlib's) of a file whose own field for it counts as 0. */
function crc32(bytes) {
    const table = Uint32Array.from({ length: 256 }, (_, byte) => {
        for (let bit = 0; bit < 8; ++bit) byte = byte & 1 ? 0xedb88320 ^ (byte >>> 1) : byte >>> 1;
        return byte;
    });
    let crc = 0xffffffff;
    for (let i = 0; i < bytes.length; ++i)
        crc = table[(crc ^ (i >= 8 && i < 12 ? 0 : bytes[i])) & 255] ^ (crc >>> 8);
    return ~crc >>> 0;
}
