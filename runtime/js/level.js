/** The level of a .gsgi file: streams of integers to Gaussians; runtime/file/FORMAT.md is the specification. */
import {
    LIGHT_OCTAVES_ABOVE, LIGHT_OCTAVES_BELOW, POSITION_MAX, SCALE_OCTAVES, SH_CODE_MAX, SLOPE_CODE_MAX, THIN, expect,
} from "./format.js";
import { openStreams } from "./integers.js";

const { abs, floor, max, sqrt } = Math;
export const SH_C0 = Math.fround(sqrt(1 / Math.PI) / 2);

/** The Gaussians whose streams take the bytes of `section`, [begin, end]; the level's `record` is already checked. */
export function decodeLevel(bytes, section, record) {
    const { count, degree, low, steps } = record;
    const [positionBits, scaleSteps, normalSteps, angleBits, opacitySteps, ...lightSteps] = steps;
    const streams = openStreams(bytes, ...section), { scale, axes } = readScales(streams, count, scaleSteps);
    const [long, middle, normal] = axes;
    // The power of two of which the position of each Gaussian is a multiple.
    const exponent = long.map((code, i) => {
        const shortest = max(Math.min(middle[i], normal[i]), code - THIN * scaleSteps);
        return max(floor(shortest / scaleSteps) - positionBits, low);
    });
    for (let i = 1; i < count; ++i) expect(exponent[i] >= exponent[i - 1], section[0]);
    const u = streams.read(count, -normalSteps, normalSteps), v = streams.read(count, -normalSteps, normalSteps);
    const bits = long.map((code, i) => code > middle[i] ? 32 - Math.clz32(code - middle[i]) + angleBits : 0);
    const angle = streams.readBits(bits), rotation = new Float32Array(4 * count), position = new Float32Array(3 * count);
    for (let i = 0; i < count; ++i)
        turn(rotation, 4 * i, u[i] / normalSteps, v[i] / normalSteps, angle[i] * Math.PI * 2 ** -bits[i]);
    for (let axis = 0; axis < 3; ++axis) readCoordinates(streams, axis, exponent, position);
    const opacity = quotients(streams.read(count, 0, opacitySteps), opacitySteps).map((root) => root * root);
    const light = readLight(streams, record, lightSteps);
    streams.finish();
    return { count, shDegree: degree, position, rotation, scale, opacity, ...light };
}

/** The lengths (N, 3) of the axes, and the codes of each axis, Int32Arrays. */
function readScales(streams, count, steps) {
    const most = SCALE_OCTAVES * steps, table = powers(steps, -most, most), long = streams.read(count, -most, most);
    const shorter = (least) => streams.check(streams.read(count, least).map((code, i) => long[i] - code), -most, most);
    const axes = [long, shorter(0), shorter()];
    return { axes, scale: new Float32Array(3 * count).map((_, i) => table[axes[i % 3][i / 3 | 0] + most]) };
}

/** Each coordinate is stored as the difference to the one before it, in its own steps, rounded down. */
function readCoordinates(streams, axis, exponent, position) {
    let code = 0, before, step = 0;
    streams.check(new Float64Array(streams.read(exponent.length)).map((difference, i) => {
        if (before !== exponent[i]) code = floor(code * step / (step = 2 ** (before = exponent[i])));
        position[3 * i + axis] = (code += difference) * step;
        return code;
    }), -POSITION_MAX, POSITION_MAX);
}

/** The light that the next streams hold, of the level of a record or of a group on it: `sh`, and `slope` or null. */
export function readLight(streams, { count, degree, basis }, [lightSteps, shSteps, slopeSteps], ofGroup) {
    const k = (degree + 1) ** 2, sh = new Float32Array(3 * k * count);
    const one = LIGHT_OCTAVES_BELOW * lightSteps + 1, most = one - 1 + LIGHT_OCTAVES_ABOVE * lightSteps;
    const table = powers(lightSteps, -one, most - one);
    table[0] = 0;
    let green;
    for (const channel of [1, 0, 2]) {
        const codes = streams.read(count).map((code, i) => code + (green ? green[i] : 0));
        green ??= codes;
        streams.check(codes, 0, most).forEach((code, i) => { sh[3 * k * i + channel] = table[code] / SH_C0; });
    }
    for (let band = 1; band <= degree; ++band) {
        const size = 3 * (2 * band + 1);
        streams.readColours(size / 3 * count, SH_CODE_MAX, ofGroup && band > 1).forEach((code, i) => {
            const first = 3 * k * floor(i / size);
            const unit = ofGroup ? sh[first + i % 3] : max(...sh.subarray(first, first + 3));
            sh[first + 3 * band * band + i % size] = Math.fround(code / shSteps) * unit;
        });
    }
    const slope = basis ? quotients(streams.read(2 * count, -SLOPE_CODE_MAX, SLOPE_CODE_MAX), slopeSteps) : null;
    return { sh, slope };
}

/** Writes the unit quaternion xyzw that carries +z to where the octahedral point (x, y) points, after a turn about it. */
function turn(to, at, x, y, angle) {
    let z = 1 - abs(x) - abs(y);
    const below = z < 0;
    if (below) [x, y] = [(1 - abs(y)) * (x < 0 ? -1 : 1), (1 - abs(x)) * (y < 0 ? -1 : 1)];
    let length = sqrt(x * x + y * y + z * z);
    x /= length;
    y /= below ? -length : length;
    z = 1 + abs(z / length);
    length = sqrt(y * y + x * x + z * z);
    const qx = -y / length, qy = x / length, qw = z / length, s = Math.sin(angle / 2), c = Math.cos(angle / 2);
    const a = qx * c + qy * s, b = qy * c - qx * s, d = qw * s, e = qw * c;
    to[at] = below ? e : a;
    to[at + 1] = below ? -d : b;
    to[at + 2] = below ? b : d;
    to[at + 3] = below ? -a : e;
}

/** Codes in steps of 1 / steps, as float32. */
function quotients(codes, steps) {
    return new Float32Array(codes).map((code) => code / steps);
}

/** 2^(code / steps), rounded to float32, of the codes from `low` to `high`. */
function powers(steps, low, high) {
    const part = Float64Array.from({ length: steps }, (_, i) => 2 ** (i / steps));
    return Float32Array.from({ length: high - low + 1 }, (_, i) => {
        const octave = floor((low + i) / steps);
        return part[low + i - octave * steps] * 2 ** octave;
    });
}
