/** The level of a .gsgi file: streams of integers to Gaussians; runtime/file/FORMAT.md is the specification. */
import {
    LIGHT_OCTAVES_ABOVE, LIGHT_OCTAVES_BELOW, POSITION_MAX, SCALE_OCTAVES, SH_CODE_MAX, SLOPE_CODE_MAX, THIN, expect,
} from "./format.js";
import { openStreams } from "./integers.js";

const { abs, floor, max, min, sqrt } = Math;
export const SH_C0 = Math.fround(sqrt(1 / Math.PI) / 2);

/** The Gaussians whose streams take the bytes of `section`, [begin, end]; the level's `record` is already checked. */
export function decodeLevel(bytes, section, record) {
    const { count, degree, low, steps } = record;
    const [positionBits, scaleSteps, normalSteps, angleBits, opacitySteps, ...lightSteps] = steps;
    const streams = openStreams(bytes, ...section);
    const [scale, long, middle, normal] = readScales(streams, count, scaleSteps), bits = new Int32Array(count);
    const exponent = new Int32Array(count); // of 2, of which the position of each Gaussian is a multiple
    let before = low;
    for (let i = 0; i < count; ++i) {
        const shortest = max(min(middle[i], normal[i]), long[i] - THIN * scaleSteps);
        exponent[i] = max(floor(shortest / scaleSteps) - positionBits, low);
        expect(before <= exponent[i], streams.begin);
        before = exponent[i];
        bits[i] = long[i] > middle[i] && 32 - Math.clz32(long[i] - middle[i]) + angleBits;
    }
    const u = streams.read(count, -normalSteps, normalSteps), v = streams.read(count, -normalSteps, normalSteps);
    const angle = streams.readBits(bits.slice()), rotation = new Float32Array(4 * count);
    for (let i = 0; i < count; ++i)
        turn(rotation, 4 * i, u[i] / normalSteps, v[i] / normalSteps, angle[i] * Math.PI / (1 << bits[i] >>> 0));
    const position = new Float32Array(3 * count);
    for (let axis = 0; axis < 3; ++axis) readCoordinates(streams, axis, exponent, position);
    const opacity = quotients(streams.read(count, 0, opacitySteps), opacitySteps).map((root) => root * root);
    const light = readLight(streams, record, lightSteps);
    streams.finish();
    return { count, shDegree: degree, position, rotation, scale, opacity, ...light };
}

/** The lengths (N, 3) of the axes, and then the codes of each axis, Int32Arrays. */
function readScales(streams, count, steps) {
    const most = SCALE_OCTAVES * steps, table = powers(steps, -most, most), scale = new Float32Array(3 * count);
    const long = streams.read(count), axes = [long, streams.read(count, 0), streams.read(count)];
    axes.forEach((codes, axis) => {
        for (let i = 0; i < count; ++i) {
            if (axis) codes[i] = long[i] - codes[i];
            expect(abs(codes[i]) <= most, streams.begin);
            scale[3 * i + axis] = table[codes[i] + most];
        }
    });
    return [scale, ...axes];
}

/** Each coordinate is stored as the difference to the one before it, in its own steps, rounded down. */
function readCoordinates(streams, axis, exponent, position) {
    const differences = streams.read(exponent.length);
    let code = 0, before, step = 0;
    for (let i = 0; i < exponent.length; ++i) {
        if (before !== exponent[i]) code = floor(code * step / (step = 2 ** (before = exponent[i])));
        code += differences[i];
        expect(abs(code) <= POSITION_MAX, streams.begin);
        position[3 * i + axis] = code * step;
    }
}

/** The light that the next streams hold, of the level of a record or of a group on it: `sh`, and `slope` or null. */
export function readLight(streams, { count, degree, basis }, [lightSteps, shSteps, slopeSteps], ofGroup) {
    const k = (degree + 1) ** 2, sh = new Float32Array(3 * k * count);
    const one = LIGHT_OCTAVES_BELOW * lightSteps + 1, most = (LIGHT_OCTAVES_BELOW + LIGHT_OCTAVES_ABOVE) * lightSteps;
    const table = powers(lightSteps, -one, most - one).map((light) => light / SH_C0);
    table[0] = 0;
    let green = new Int32Array(count);
    [1, 0, 2].forEach((channel) => {
        const codes = streams.read(count);
        for (let i = 0; i < count; ++i) {
            const code = green[i] + codes[i];
            expect(0 <= code && code <= most, streams.begin);
            sh[3 * k * i + channel] = table[code];
        }
        if (channel === 1) green = codes;
    });
    for (let band = 1; band <= degree; ++band) {
        const size = 3 * (2 * band + 1);
        streams.colours(size / 3 * count, SH_CODE_MAX, ofGroup && band > 1).forEach((code, i) => {
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
    return new Float32Array(high - low + 1).map((_, i) => {
        const octave = floor((low + i) / steps);
        return 2 ** ((low + i - octave * steps) / steps) * 2 ** octave;
    });
}
