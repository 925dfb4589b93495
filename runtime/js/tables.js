/** The textures that the GLSL of lookup.js reads. */

import { appendLists, axesOf } from "./cell_lists.js";
import { HEADER_TEXELS, texelCount, writeLight } from "./lookup.js";
import { DATA_WIDTH, SCALE_MIN } from "./shaders.js";

const FAR = 16; // distance from the origin in diagonals of the bake at which float32 becomes too coarse
const EXACT = 1 << 24; // texels; float32 counts no further, in which the header says where things begin
const { hypot, max, min } = Math;

/**
 * What lookupSource() reads of a bake: texels in rows of `width`, filled up with zeros.
 *
 * gaussians: Float32Array for RGBA32F; cells: Uint32Array for R32UI; lists: Uint16Array for R16UI, or Uint32Array for
 * R32UI. glsl/surface/lookup.glsl describes them. Throws RangeError for a bake of the `over` operator and for more
 * Gaussians than textures of `maxSize` rows hold.
 */
export function lookupTables(bake, maxSize = 2048) {
    if (bake.operator !== "surface") throw new RangeError('this needs light of "surface"');
    const { sharpness, cutoff, floor } = bake.blend, origin = originOf(bake).map(Math.fround);
    const radius = Math.sqrt(-2 * Math.log(cutoff));
    const header = [], texels = Array(4 * HEADER_TEXELS), cells = [], lists = [0]; // no list begins at 0
    for (const [decoded, power] of [[bake.fine, sharpness], [bake.coarse, 0]]) {
        const level = local(decoded, origin), firstNode = cells.length;
        const [low, edge, size, child] = appendLists(level, radius, !power, cells, lists);
        header.push(...low, 1 / edge, ...size, firstNode, texels.length / 4, power, child, 0);
        for (const number of gaussianTexels(level)) texels.push(number);
    }
    header.push(...origin, cutoff, floor, 0, 0, 0);
    texels.splice(0, header.length, ...header);
    if (max(texels.length / 4, cells.length, lists.length) > min(EXACT, maxSize * DATA_WIDTH))
        throw new RangeError(`${bake.fine.count} Gaussians: too many for textures of ${maxSize} rows`);
    return {
        width: DATA_WIDTH,
        gaussians: padded(Float32Array, 4, texels),
        cells: padded(Uint32Array, 1, cells),
        lists: padded(lists.every((number) => number < 1 << 16) ? Uint16Array : Uint32Array, 1, lists),
    };
}

/** The middle of a bake that lies far from the world's origin, where float32 is too coarse; else the origin. */
function originOf({ fine, coarse }) {
    const bounds = [0, 1, 2].map((k) => {
        const x = Float32Array.from([...fine.position, ...coarse.position].filter((_, i) => i % 3 === k)).sort();
        return [x[0], x.at(-1)];
    });
    const middle = bounds.map(([low, high]) => (low + high) / 2);
    const far = hypot(...middle) > FAR * hypot(...bounds.map(([low, high]) => high - low));
    return far ? middle : [0, 0, 0];
}

/** A level relative to `origin`, with the scales that shaders can invert. */
function local(level, origin) {
    const position = level.position.map((x, i) => x - origin[i % 3]);
    return { ...level, position, scale: level.scale.map((x) => max(x, SCALE_MIN)) };
}

function gaussianTexels(level) {
    const { count, position, rotation, scale, opacity } = level;
    const stride = 4 * texelCount(level), texels = new Float32Array(stride * count);
    for (let i = 0; i < count; ++i) {
        const [first, second] = axesOf(rotation.subarray(4 * i)), deviation = scale.subarray(3 * i);
        texels.set([
            ...position.subarray(3 * i, 3 * i + 3), min(opacity[i], 1),
            ...first.map((x) => x / deviation[0]), 1 / deviation[2],
            ...second.map((x) => x / deviation[1]),
        ], stride * i);
    }
    writeLight(texels, level);
    return texels;
}

/** The numbers in whole rows of texels of that many channels. */
function padded(Kind, channels, numbers) {
    const row = DATA_WIDTH * channels, result = new Kind(Math.ceil(numbers.length / row) * row);
    result.set(numbers);
    return result;
}
