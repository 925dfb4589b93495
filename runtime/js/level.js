/** The level of a .gsgi file: streams of integers to Gaussians; runtime/file/FORMAT.md is the specification. */
import { Integers } from "./integers.js";

export const SH_C0 = Math.fround(Math.sqrt(1 / Math.PI) / 2);
const SCALE_OCTAVES = 57, THIN = 4, LIGHT_OCTAVES_BELOW = 32, LIGHT_OCTAVES_ABOVE = 16;
const POSITION_MAX = 2 ** 24 - 1, SH_CODE_MAX = 2 ** 20, SLOPE_CODE_MAX = 127;
const f = Math.fround;

/** The fewest bytes that the streams of a level take. */
export function leastBytes({ count, degree, basis }) {
    const least = (numbers) => 3 + Math.ceil(numbers / 8);
    let bytes = 12 * least(count);
    for (let band = 1; band <= degree; ++band)
        bytes += least((2 * band + 1) * count) + least(2 * (2 * band + 1) * count);
    return bytes + (basis ? least(2 * count) : 0);
}

/**
 * The Gaussians whose streams take `bytes` from `begin` to `end`; `level` is their record, already checked.
 * `expect(condition, byte, field)` throws if the condition is false.
 */
export function decodeLevel(bytes, { begin, end }, level, expect) {
    const { count, degree } = level, streams = new Streams(bytes, begin, end, level.name, expect);
    const gaussians = {
        count, shDegree: degree,
        position: new Float32Array(3 * count), rotation: new Float32Array(4 * count), scale: new Float32Array(3 * count),
        opacity: null,
    };
    const scale = readScales(streams, level, gaussians.scale), exponent = exponents(scale, level);
    streams.check(exponent.every((each, i) => i === 0 || each >= exponent[i - 1]));
    readRotations(streams, level, scale, gaussians.rotation);
    for (let axis = 0; axis < 3; ++axis) readCoordinates(streams, axis, exponent, gaussians.position);
    gaussians.opacity = quotients(streams.within("opacity", count, 0, level.opacitySteps), level.opacitySteps);
    for (let i = 0; i < count; ++i) gaussians.opacity[i] *= gaussians.opacity[i];
    Object.assign(gaussians, streams.light(level));
    streams.finish();
    return gaussians;
}

/** The streams of a level, or of a light group, one after the other. */
export class Streams {
    constructor(bytes, begin, end, name, expect) {
        Object.assign(this, { name, field: name, start: begin, expect });
        this.integers = new Integers(bytes, begin, end, (condition, byte) => expect(condition, byte, this.field));
    }

    /** The integers of the next stream, an Int32Array; `stream` is its name. */
    read(stream, count) {
        this.enter(stream);
        return this.integers.read(count);
    }

    /** The same, of a stream whose integers are codes from `low` to `high`. */
    within(stream, count, low, high) {
        return this.checkSteps(this.read(stream, count), low, high);
    }

    /** The light that the next streams hold, of Gaussians whose record is `level`: `sh`, and `slope` or null. */
    light(level) {
        const { count, degree, basis, slopeSteps } = level, sh = new Float32Array(3 * (degree + 1) ** 2 * count);
        readLight(this, level, sh);
        for (let band = 1; band <= degree; ++band) readBand(this, band, level, sh);
        const codes = basis && this.within("slope", 2 * count, -SLOPE_CODE_MAX, SLOPE_CODE_MAX);
        return { sh, slope: codes ? quotients(codes, slopeSteps) : null };
    }

    /** Names what is read next. */
    enter(stream) {
        this.field = `${this.name}.${stream}`;
        this.start = this.integers.at;
    }

    /** All has been read. */
    finish() {
        this.expect(this.integers.at === this.integers.end, this.integers.at, this.name);
    }

    check(condition) {
        this.expect(condition, this.start, this.field);
    }

    checkSteps(codes, low, high) {
        let fine = true;
        for (let i = 0; i < codes.length; ++i) fine &&= codes[i] >= low && codes[i] <= high;
        this.check(fine);
        return codes;
    }
}

/** The codes of the three axes, Int32Arrays; their lengths are written to `scale`. */
function readScales(streams, { count, scaleSteps }, scale) {
    const most = SCALE_OCTAVES * scaleSteps, table = powers(scaleSteps, -most, most), found = [];
    for (const [axis, stream] of ["scale_long", "scale_middle", "scale_normal"].entries()) {
        const codes = streams.read(stream, count);
        if (axis === 1) streams.checkSteps(codes, 0, Infinity);
        for (let i = 0; i < count && axis; ++i) codes[i] = found[0][i] - codes[i];
        found.push(streams.checkSteps(codes, -most, most));
        for (let i = 0; i < count; ++i) scale[3 * i + axis] = table[codes[i] + most];
    }
    return found;
}

/** The power of two of which the position of each Gaussian is a multiple. */
function exponents([long, middle, normal], { scaleSteps, positionBits, positionFloor }) {
    return long.map((code, i) => {
        const shortest = Math.max(Math.min(middle[i], normal[i]), code - THIN * scaleSteps);
        return Math.max(Math.floor(shortest / scaleSteps) - positionBits, positionFloor);
    });
}

function readRotations(streams, { count, normalSteps, angleBits }, [long, middle], rotation) {
    const u = streams.within("normal_u", count, -normalSteps, normalSteps);
    const v = streams.within("normal_v", count, -normalSteps, normalSteps);
    const bits = long.map((code, i) => code > middle[i] ? 32 - Math.clz32(code - middle[i]) + angleBits : 0);
    streams.enter("angle");
    const angle = streams.integers.readBits(bits.slice()), halves = Float64Array.from({ length: 32 }, (_, i) => 2 ** -i);
    for (let i = 0; i < count; ++i)
        rotationOf(u[i], v[i], normalSteps, angle[i] * Math.PI * halves[bits[i]], rotation, 4 * i);
}

/** Each coordinate is stored as the difference to the one before it, in its own steps, rounded down. */
function readCoordinates(streams, axis, exponent, position) {
    const codes = streams.read(`position_${"xyz"[axis]}`, exponent.length);
    let fine = true, code = 0, before = exponent[0], step = 2 ** before;
    for (let i = 0; i < codes.length && fine; ++i) {
        if (exponent[i] > before) {
            code = Math.floor(code * 2 ** (before - exponent[i]));
            before = exponent[i];
            step = 2 ** before;
        }
        code += codes[i];
        fine = Math.abs(code) <= POSITION_MAX;
        position[3 * i + axis] = code * step;
    }
    streams.check(fine);
}

/** Writes the constant coefficients to `sh`. */
function readLight(streams, { count, degree, lightSteps }, sh) {
    const stride = 3 * (degree + 1) ** 2, one = LIGHT_OCTAVES_BELOW * lightSteps + 1;
    const most = one - 1 + LIGHT_OCTAVES_ABOVE * lightSteps, table = powers(lightSteps, -one, most - one);
    table[0] = 0;
    let green = null;
    for (const [stream, channel] of [["green", 1], ["red", 0], ["blue", 2]]) {
        const codes = streams.read(stream, count);
        for (let i = 0; i < count && green; ++i) codes[i] += green[i];
        green ??= codes;
        streams.checkSteps(codes, 0, most);
        for (let i = 0; i < count; ++i) sh[stride * i + channel] = table[codes[i]] / SH_C0;
    }
}

/** Adds a band of coefficients to `sh`, which has the constant one. */
function readBand(streams, band, { count, degree, shSteps }, sh) {
    const size = 2 * band + 1, k = (degree + 1) ** 2;
    const green = streams.within(`sh${band}_green`, size * count, -SH_CODE_MAX, SH_CODE_MAX);
    const others = streams.read(`sh${band}_red_blue`, 2 * size * count);
    for (let i = 0; i < others.length; ++i) others[i] += green[i >> 1];
    streams.checkSteps(others, -SH_CODE_MAX, SH_CODE_MAX);
    for (let i = 0; i < count; ++i) {
        const first = 3 * k * i, brightest = Math.max(sh[first], sh[first + 1], sh[first + 2]);
        for (let j = 0; j < size; ++j) {
            const from = i * size + j, to = first + 3 * (band * band + j);
            sh[to] = f(others[2 * from] / shSteps) * brightest;
            sh[to + 1] = f(green[from] / shSteps) * brightest;
            sh[to + 2] = f(others[2 * from + 1] / shSteps) * brightest;
        }
    }
}

/** Writes the unit quaternion xyzw that carries +z to where the octahedral code points, after a turn about it. */
function rotationOf(u, v, steps, turn, rotation, first) {
    let x = u / steps, y = v / steps, z = 1 - Math.abs(x) - Math.abs(y);
    if (z < 0) [x, y] = [(1 - Math.abs(y)) * (x < 0 ? -1 : 1), (1 - Math.abs(x)) * (y < 0 ? -1 : 1)];
    const below = z < 0;
    let length = Math.sqrt(x * x + y * y + z * z);
    x /= length;
    y = below ? -(y / length) : y / length;
    z = Math.abs(z / length);
    length = Math.sqrt(y * y + x * x + (1 + z) * (1 + z));
    const qx = -y / length, qy = x / length, qw = (1 + z) / length;
    const sin = Math.sin(turn / 2), cos = Math.cos(turn / 2);
    const a = qx * cos + qy * sin, b = qy * cos - qx * sin, c = qw * sin, d = qw * cos;
    rotation[first] = below ? d : a;
    rotation[first + 1] = below ? -c : b;
    rotation[first + 2] = below ? b : c;
    rotation[first + 3] = below ? -a : d;
}

/** Codes in steps of 1 / steps, as float32. */
function quotients(codes, steps) {
    const values = new Float32Array(codes.length);
    for (let i = 0; i < codes.length; ++i) values[i] = codes[i] / steps;
    return values;
}

/** 2^(code / steps), rounded to float32, of the codes from `low` to `high`. */
function powers(steps, low, high) {
    const part = Float64Array.from({ length: steps }, (_, i) => 2 ** (i / steps));
    return Float32Array.from({ length: high - low + 1 }, (_, i) => {
        const octave = Math.floor((low + i) / steps);
        return part[low + i - octave * steps] * 2 ** octave;
    });
}
