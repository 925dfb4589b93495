/** Decodes .gsgi files; runtime/file/FORMAT.md is the specification. */

const MAGIC = 0x49475347; // "GSGI"
const VERSION = 4;
const HEADER_BYTES = 144;
const FINE = 56, COARSE = 100; // where the records of the levels begin
const EFFECT_BITS = 0x1ff;
const GAUSSIAN_COUNT_MAX = 1 << 24;
const FLOAT_MAX = 3.4028234663852886e38;
const SH_C0 = Math.fround(Math.sqrt(1 / Math.PI) / 2);
const ROTATION_STEPS = Math.fround(511 * Math.SQRT2);
const f = Math.fround;

/** A file that no encoder can have written; the message names byte and field. */
export class FormatError extends Error {
    name = "FormatError";
}

function expect(condition, byte, field, expected, got) {
    if (!condition) throw new FormatError(`byte ${byte} (${field}): expected ${expected}, got ${got}`);
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

    const levels = [readLevel(view, FINE, "fine"), readLevel(view, COARSE, "coarse")];
    const count = levels[0].count + levels[1].count;
    expect(count <= GAUSSIAN_COUNT_MAX, COARSE, "coarse.gaussian_count", `at most ${GAUSSIAN_COUNT_MAX}`, count);
    const size = HEADER_BYTES + levels[0].bytes + levels[1].bytes;
    expect(bytes.length === size, Math.min(bytes.length, size), "length", `${size} bytes`, bytes.length);
    const crc = crc32(bytes), stored = view.getUint32(8, true);
    expect(stored === crc, 8, "crc32", crc, `${stored}: the file is damaged`);

    const bake = readHeader(view, levels);
    bake.fine = decodeLevel(view, HEADER_BYTES, levels[0]);
    bake.coarse = bake.operator === "surface" ? decodeLevel(view, HEADER_BYTES + levels[0].bytes, levels[1]) : null;
    return bake;
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
    expect(operator < 2, 12, "operator", "0 (over) or 1 (surface)", operator);
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
        expect(levels[0].basis === 0, FINE + 6, "fine.basis", 0, levels[0].basis);
        for (let byte = COARSE; byte < HEADER_BYTES; ++byte)
            expect(view.getUint8(byte) === 0, byte, "coarse", "zeros, since over has none", view.getUint8(byte));
    }
    for (const level of levels) checkLevel(level, surface ? 2 : 3);
    return {
        operator: surface ? "surface" : "over", effects, bounces: view.getUint16(16, true), toneScale,
        scene: view.getBigUint64(24, true),
        blend: surface ? { sharpness, cutoff, floor } : { near, dilation, alphaMin, alphaMax },
    };
}

/** A level's record; what its length follows from is checked. */
function readLevel(view, byte, name) {
    const numbers = Array.from({ length: 9 }, (_, i) => view.getFloat32(byte + 8 + 4 * i, true));
    const level = {
        byte, name,
        count: view.getUint32(byte, true), degree: view.getUint16(byte + 4, true), basis: view.getUint16(byte + 6, true),
        positionMin: numbers.slice(0, 3), positionStep: numbers.slice(3, 6),
        logScaleMin: numbers[6], logScaleStep: numbers[7], shRestStep: numbers[8],
    };
    expect(level.count <= GAUSSIAN_COUNT_MAX, byte, `${name}.gaussian_count`, `at most ${GAUSSIAN_COUNT_MAX}`, level.count);
    expect(level.degree <= 3, byte + 4, `${name}.sh_degree`, "0 to 3", level.degree);
    expect(level.basis <= 1, byte + 6, `${name}.basis`, "0 or 1", level.basis);
    level.bytes = level.count * (18 + 3 * ((level.degree + 1) ** 2 - 1) + 2 * level.basis);
    return level;
}

function checkLevel({ byte, name, degree, positionMin, positionStep, ...level }, highest) {
    const { logScaleMin: low, logScaleStep, shRestStep } = level;
    expect(degree <= highest, byte + 4, `${name}.sh_degree`, `0 to ${highest}`, degree);
    for (const [i, value] of [...positionMin, ...positionStep, low, logScaleStep, shRestStep].entries()) {
        expect(Number.isFinite(value), byte + 8 + 4 * i, `${name}, a number`, "a finite one", value);
        expect(i < 3 || i === 6 || value >= 0, byte + 8 + 4 * i, `${name}, a step`, "0 or more", value);
    }
    const high = low + 255 * logScaleStep;
    expect(low >= -40 && high <= 40, byte + 32, `${name}.log_scale_min`, "scales within exp(+-40)", low);
    for (let k = 0; k < 3; ++k)
        expect(Math.abs(positionMin[k]) + 65535 * positionStep[k] < FLOAT_MAX, byte + 20 + 4 * k,
            `${name}.position_step`, "positions within float32", positionStep[k]);
    expect(shRestStep <= f(1e30), byte + 40, `${name}.sh_rest_step`, "at most 1e30", shRestStep);
}

/** The Gaussians whose arrays begin at byte `at`. */
function decodeLevel(view, at, level) {
    const { count, degree, basis } = level, k = (degree + 1) ** 2;
    const rotations = at, colors = rotations + 4 * count, positions = colors + 4 * count;
    const scales = positions + 6 * count, opacities = scales + 3 * count;
    const rests = opacities + count, slopes = rests + 3 * (k - 1) * count;
    const gaussians = {
        count, shDegree: degree,
        position: new Float32Array(3 * count), rotation: new Float32Array(4 * count), scale: new Float32Array(3 * count),
        opacity: new Float32Array(count), sh: new Float32Array(3 * k * count),
        slope: basis ? new Float32Array(2 * count) : null,
    };
    const scaleOf = Float32Array.from({ length: 256 },
        (_, code) => Math.exp(f(level.logScaleMin + f(code * level.logScaleStep))));
    for (let i = 0; i < count; ++i) {
        unpackRotation(view.getUint32(rotations + 4 * i, true), gaussians.rotation, 4 * i);
        for (let j = 0; j < 3; ++j) {
            const code = view.getUint16(positions + 6 * i + 2 * j, true);
            gaussians.position[3 * i + j] = level.positionMin[j] + f(code * level.positionStep[j]);
            gaussians.scale[3 * i + j] = scaleOf[view.getUint8(scales + 3 * i + j)];
        }
        gaussians.opacity[i] = view.getUint8(opacities + i) / 255;
        const packed = view.getUint32(colors + 4 * i, true), first = 3 * k * i, exponent = 2 ** ((packed >>> 27) - 24);
        let brightest = 0;
        for (let j = 0; j < 3; ++j) {
            const light = f((packed >>> (9 * j) & 511) * exponent / SH_C0);
            gaussians.sh[first + j] = light;
            brightest = Math.max(brightest, light);
        }
        for (let j = 0; j < 3 * (k - 1); ++j)
            gaussians.sh[first + 3 + j] = f(view.getInt8(rests + 3 * (k - 1) * i + j) * level.shRestStep) * brightest;
        for (let j = 0; j < 2 * basis; ++j)
            gaussians.slope[2 * i + j] = view.getInt8(slopes + 2 * i + j) / 256;
    }
    return gaussians;
}

/** Writes the unit quaternion xyzw of a smallest-three code to `rotation` at `first`. */
function unpackRotation(packed, rotation, first) {
    const largest = packed >>> 30;
    let squares = 0, length = 0;
    for (let i = 0, shift = 20; i < 4; ++i) {
        if (i === largest) continue;
        const value = f(((packed >>> shift & 1023) - 511) / ROTATION_STEPS);
        squares = f(squares + f(value * value));
        rotation[first + i] = value;
        shift -= 10;
    }
    rotation[first + largest] = Math.sqrt(Math.max(0, f(1 - squares)));
    for (let i = 0; i < 4; ++i) length = f(length + f(rotation[first + i] * rotation[first + i]));
    length = f(Math.sqrt(length));
    for (let i = 0; i < 4; ++i) rotation[first + i] /= length;
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
