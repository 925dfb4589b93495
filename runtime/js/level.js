/** The level of a .gsgi file: streams of integers to Gaussians; runtime/file/FORMAT.md is the specification. */
import { Integers } from "./integers.js";

const SH_C0 = Math.fround(Math.sqrt(1 / Math.PI) / 2);
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
 * The Gaussians whose streams take `bytes` from `at` to `end`; `level` is their record, already checked.
 * `expect(condition, byte, field, expected)` throws if the condition is false.
 */
export function decodeLevel(bytes, { begin, end }, level, expect) {
    const { count, degree, basis } = level, k = (degree + 1) ** 2;
    let field = level.name, start = begin;
    const integers = new Integers(bytes, begin, end, (condition, byte, expected) => expect(condition, byte, field, expected));
    const enter = (stream) => {
        field = `${level.name}.${stream}`;
        start = integers.at;
    };
    const read = (stream, numbers) => {
        enter(stream);
        return integers.read(numbers);
    };
    const within = (codes, low, high, expected = `steps from ${low} to ${high}`) => {
        let fine = true;
        for (let i = 0; i < codes.length; ++i) fine &&= codes[i] >= low && codes[i] <= high;
        expect(fine, start, field, expected);
        return codes;
    };
    const gaussians = {
        count, shDegree: degree,
        position: new Float32Array(3 * count), rotation: new Float32Array(4 * count), scale: new Float32Array(3 * count),
        opacity: new Float32Array(count), sh: new Float32Array(3 * k * count),
        slope: basis ? new Float32Array(2 * count) : null,
    };

    const scale = readScales(level, read, within);
    const exponent = exponents(scale, level);
    expect(exponent.every((each, i) => i === 0 || each >= exponent[i - 1]), start, field, "positions in steps that do not shrink");
    const scaleMax = SCALE_OCTAVES * level.scaleSteps, scaleOf = powers(level.scaleSteps, -scaleMax, scaleMax);
    for (let axis = 0; axis < 3; ++axis)
        for (let i = 0; i < count; ++i) gaussians.scale[3 * i + axis] = scaleOf[scale[axis][i] + scaleMax];

    const { normalSteps } = level;
    const u = within(read("normal_u", count), -normalSteps, normalSteps);
    const v = within(read("normal_v", count), -normalSteps, normalSteps);
    const angleBits = scale[0].map((code, i) => code > scale[1][i] ? 32 - Math.clz32(code - scale[1][i]) + level.angleBits : 0);
    enter("angle");
    const angle = integers.readBits(angleBits.slice());
    const halves = Float64Array.from({ length: 32 }, (_, i) => 2 ** -i);
    for (let i = 0; i < count; ++i)
        rotationOf(u[i], v[i], normalSteps, angle[i] * Math.PI * halves[angleBits[i]], gaussians.rotation, 4 * i);

    for (let axis = 0; axis < 3; ++axis) {
        const codes = read(`position_${"xyz"[axis]}`, count);
        let fine = true;
        for (let i = 0, code = 0, before = exponent[0], step = 2 ** before; i < count && fine; ++i) {
            if (exponent[i] > before) {
                code = Math.floor(code * 2 ** (before - exponent[i]));
                before = exponent[i];
                step = 2 ** before;
            }
            code += codes[i];
            fine = Math.abs(code) <= POSITION_MAX;
            gaussians.position[3 * i + axis] = code * step;
        }
        expect(fine, start, field, `steps from ${-POSITION_MAX} to ${POSITION_MAX}`);
    }

    const opacity = within(read("opacity", count), 0, level.opacitySteps);
    for (let i = 0; i < count; ++i) gaussians.opacity[i] = f(opacity[i] / level.opacitySteps) ** 2;

    const one = LIGHT_OCTAVES_BELOW * level.lightSteps + 1, lightMax = one - 1 + LIGHT_OCTAVES_ABOVE * level.lightSteps;
    const lightOf = powers(level.lightSteps, -one, lightMax - one);
    let green = null;
    for (const [stream, channel] of [["green", 1], ["red", 0], ["blue", 2]]) {
        const codes = read(stream, count);
        for (let i = 0; i < count && green; ++i) codes[i] += green[i];
        green ??= codes;
        within(codes, 0, lightMax);
        for (let i = 0; i < count; ++i)
            gaussians.sh[3 * k * i + channel] = codes[i] ? lightOf[codes[i]] / SH_C0 : 0;
    }

    for (let band = 1; band <= degree; ++band) readBand(band, level, read, within, gaussians.sh);
    if (basis) {
        const codes = within(read("slope", 2 * count), -SLOPE_CODE_MAX, SLOPE_CODE_MAX);
        for (let i = 0; i < 2 * count; ++i) gaussians.slope[i] = codes[i] / level.slopeSteps;
    }
    expect(integers.at === end, integers.at, level.name, "the end of the section");
    return gaussians;
}

/** The codes of the three axes, Int32Arrays. */
function readScales({ count, scaleSteps }, read, within) {
    const most = SCALE_OCTAVES * scaleSteps, expected = `scales within 2^+-${SCALE_OCTAVES} m`;
    const long = within(read("scale_long", count), -most, most, expected);
    return [long, ...["scale_middle", "scale_normal"].map((stream) => {
        const codes = read(stream, count);
        if (stream === "scale_middle") within(codes, 0, Infinity, "a second axis no longer than the first");
        return within(codes.map((code, i) => long[i] - code), -most, most, expected);
    })];
}

/** The power of two of which the position of each Gaussian is a multiple. */
function exponents([long, middle, normal], { scaleSteps, positionBits, positionFloor }) {
    return long.map((code, i) => {
        const shortest = Math.max(Math.min(middle[i], normal[i]), code - THIN * scaleSteps);
        return Math.max(Math.floor(shortest / scaleSteps) - positionBits, positionFloor);
    });
}

/** Adds a band of coefficients to `sh`, which has the constant one. */
function readBand(band, { count, degree, shSteps }, read, within, sh) {
    const size = 2 * band + 1, k = (degree + 1) ** 2;
    const green = within(read(`sh${band}_green`, size * count), -SH_CODE_MAX, SH_CODE_MAX);
    const others = read(`sh${band}_red_blue`, 2 * size * count);
    for (let i = 0; i < others.length; ++i) others[i] += green[i >> 1];
    within(others, -SH_CODE_MAX, SH_CODE_MAX);
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

/** 2^(code / steps), rounded to float32, of the codes from `low` to `high`. */
function powers(steps, low, high) {
    const part = Float64Array.from({ length: steps }, (_, i) => 2 ** (i / steps));
    return Float32Array.from({ length: high - low + 1 }, (_, i) => {
        const octave = Math.floor((low + i) / steps);
        return part[low + i - octave * steps] * 2 ** octave;
    });
}
