/** Decodes .gsgi files; runtime/file/FORMAT.md is the specification. */
import { decodeLevel, leastBytes } from "./level.js";

const MAGIC = 0x49475347; // "GSGI"
const VERSION = 5;
const HEADER_BYTES = 88, SECTION_BYTES = 8;
const FINE = 56, COARSE = 72; // where the records of the levels begin
const EFFECT_BITS = 0x1ff;
const GAUSSIAN_COUNT_MAX = 1 << 24;
const TAGS = ["FINE", "COAR"];

/** A file that no encoder can have written; the message names byte and field. */
export class FormatError extends Error {
    name = "FormatError";
}

function expect(condition, byte, field, expected, got) {
    if (condition) return;
    throw new FormatError(`byte ${byte} (${field}): expected ${expected}${got === undefined ? "" : `, got ${got}`}`);
}

/**
 * The bake in the bytes of a .gsgi file, an ArrayBuffer or a view of one.
 *
 * The numbers are those of the Python reader, to the last bit of float32. The input may come from anywhere: what
 * FORMAT.md says must be refused is a FormatError, before anything is allocated by what it states.
 */
export function decode(data) {
    const bytes = ArrayBuffer.isView(data)
        ? new Uint8Array(data.buffer, data.byteOffset, data.byteLength) : new Uint8Array(data);
    expect(bytes.length >= HEADER_BYTES, bytes.length, "header", `${HEADER_BYTES} bytes`, bytes.length);
    const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
    const magic = view.getUint32(0, true), version = view.getUint16(4, true), header = view.getUint16(6, true);
    expect(magic === MAGIC, 0, "magic", MAGIC, magic);
    expect(version === VERSION, 4, "version", VERSION, version);
    expect(header === HEADER_BYTES, 6, "header_bytes", HEADER_BYTES, header);

    const operator = view.getUint8(12);
    expect(operator < 2, 12, "operator", "0 (over) or 1 (surface)", operator);
    const highest = operator === 1 ? 2 : 3;
    const levels = [readLevel(view, FINE, "fine", highest), readLevel(view, COARSE, "coarse", highest)];
    const count = levels[0].count + levels[1].count;
    expect(count <= GAUSSIAN_COUNT_MAX, COARSE, "coarse.gaussian_count", `at most ${GAUSSIAN_COUNT_MAX}`, count);
    const sections = findSections(view, operator === 1 ? levels : levels.slice(0, 1));
    const crc = crc32(bytes), stored = view.getUint32(8, true);
    expect(stored === crc, 8, "crc32", crc, `${stored}: the file is damaged`);

    const bake = readHeader(view, levels);
    [bake.fine, bake.coarse = null] = sections.map((section, i) => decodeLevel(bytes, section, levels[i], expect));
    return bake;
}

/** Where the sections of these levels begin and end. They come first; others are skipped. */
function findSections(view, levels) {
    const found = [];
    for (let at = HEADER_BYTES; at < view.byteLength || found.length < levels.length;) {
        const level = levels[found.length], name = level?.name ?? "section";
        expect(at + SECTION_BYTES <= view.byteLength, view.byteLength, name, "a section", "the end of the file");
        const tag = String.fromCharCode(...[0, 1, 2, 3].map((i) => view.getUint8(at + i)));
        const size = view.getUint32(at + 4, true), least = level ? leastBytes(level) : 0;
        if (level) expect(tag === TAGS[found.length], at, name, TAGS[found.length], tag);
        else expect(!TAGS.includes(tag), at, name, "no second one", tag);
        expect(size >= least, at + 4, name, `at least ${least} bytes`, size);
        at += SECTION_BYTES;
        expect(size <= view.byteLength - at, view.byteLength, name, `${size} bytes`, view.byteLength - at);
        if (level) found.push({ begin: at, end: at + size });
        at += size;
    }
    return found;
}

/** The header's fields, checked, but for the levels. */
function readHeader(view, levels) {
    const number = (byte, field) => {
        const value = view.getFloat32(byte, true);
        expect(Number.isFinite(value), byte, field, "a finite number", value);
        return value;
    };
    const operator = view.getUint8(12), sharpness = view.getUint8(13), effects = view.getUint16(14, true);
    const surface = operator === 1, reserved = view.getUint16(18, true), toneScale = number(20, "tone_scale");
    expect((effects & ~EFFECT_BITS) === 0, 14, "effects", "bits of 0x1ff", effects);
    expect(reserved === 0, 18, "reserved", 0, reserved);
    expect(toneScale > 0, 20, "tone_scale", "more than 0", toneScale);
    const [near, dilation, alphaMin, alphaMax, cutoff, floor] =
        ["near", "dilation", "alpha_min", "alpha_max", "cutoff", "floor"].map((field, i) => number(32 + 4 * i, field));
    if (surface) {
        for (const [i, value] of [near, dilation, alphaMin, alphaMax].entries())
            expect(value === 0, 32 + 4 * i, "a field of over", 0, value);
        expect(0 < cutoff && cutoff < 1, 48, "cutoff", "more than 0, less than 1", cutoff);
        expect(0 < floor && floor <= 1e6, 52, "floor", "more than 0, at most 1e6", floor);
        expect(1 <= sharpness && sharpness <= 64, 13, "sharpness", "1 to 64", sharpness);
    } else {
        expect(sharpness === 0 && cutoff === 0 && floor === 0, 13, "a field of surface", 0, sharpness || cutoff || floor);
        expect(near >= 0, 32, "near", "0 or more", near);
        expect(dilation >= 0, 36, "dilation", "0 or more", dilation);
        expect(0 < alphaMin && alphaMin < alphaMax && alphaMax < 1, 40, "alpha_min", "0 < alpha_min < alpha_max < 1", alphaMin);
        expect(levels[0].basis === 0, FINE + 5, "fine.basis", 0, levels[0].basis);
        for (let byte = COARSE; byte < HEADER_BYTES; ++byte)
            expect(view.getUint8(byte) === 0, byte, "coarse", "zeros, since over has none", view.getUint8(byte));
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
    const [positionBits, scaleSteps, normalSteps, angleBits, opacitySteps, lightSteps, shSteps, slopeSteps] =
        Array.from({ length: 8 }, (_, i) => view.getUint8(byte + 8 + i));
    const level = {
        byte, name,
        count: view.getUint32(byte, true), degree: view.getUint8(byte + 4), basis: view.getUint8(byte + 5),
        positionFloor: view.getInt16(byte + 6, true),
        positionBits, scaleSteps, normalSteps, angleBits, opacitySteps, lightSteps, shSteps, slopeSteps,
    };
    expect(level.count <= GAUSSIAN_COUNT_MAX, byte, `${name}.gaussian_count`, `at most ${GAUSSIAN_COUNT_MAX}`, level.count);
    expect(level.degree <= highest, byte + 4, `${name}.sh_degree`, `0 to ${highest}`, level.degree);
    expect(level.basis <= 1, byte + 5, `${name}.basis`, "0 or 1", level.basis);
    return level;
}

function checkLevel({ byte, name, positionFloor, ...level }) {
    expect(positionFloor >= -149 && positionFloor <= 104, byte + 6, `${name}.position_floor`, "-149 to 104", positionFloor);
    for (const [i, field] of [[8, "positionBits"], [11, "angleBits"]])
        expect(level[field] <= 16, byte + i, `${name}.${field}`, "at most 16", level[field]);
    const steps = ["scaleSteps", "normalSteps", , "opacitySteps", "lightSteps", "shSteps", "slopeSteps"];
    for (const [i, field] of steps.entries())
        expect(!field || level[field] > 0, byte + 9 + i, `${name}.${field}`, "at least 1", 0);
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
