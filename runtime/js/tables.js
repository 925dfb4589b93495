/** The textures that the GLSL of lookup.js reads. */

import { axesOf, cellLists } from "./cell_lists.js";
import { HEADER_TEXELS, texelCount, writeLight } from "./lookup.js";
import { DATA_WIDTH, SCALE_MIN } from "./shaders.js";

const FAR = 16; // distance from the origin in diagonals of the bake at which float32 becomes too coarse
const EXACT = 1 << 24; // texels; float32 counts no further, in which the header says where things begin

/**
 * What lookupSource() reads of a bake: texels in rows of `width`, filled up with zeros.
 *
 * gaussians: Float32Array for RGBA32F; cells: Uint32Array for R32UI; lists: Uint16Array for R16UI, or Uint32Array for
 * R32UI. glsl/surface/lookup.glsl describes them. Throws RangeError for a bake of the `over` operator and for more
 * Gaussians than textures of `maxSize` rows hold.
 */
export function lookupTables(bake, maxSize = 2048) {
    if (bake.operator !== "surface")
        throw new RangeError(`the bake has the operator "${bake.operator}": only light of "surface" can be looked up`);
    const { sharpness, cutoff, floor } = bake.blend, origin = originOf(bake).map(Math.fround);
    const radius = Math.sqrt(-2 * Math.log(cutoff));
    const header = [], texels = [], cells = [], lists = [0]; // no list begins at 0
    let firstTexel = HEADER_TEXELS;
    for (const [decoded, power] of [[bake.fine, sharpness], [bake.coarse, 0]]) {
        const level = local(decoded, origin), grid = cellLists(level, radius), rows = gaussianTexels(level);
        header.push(...grid.low, 1 / grid.edge, ...grid.size, cells.length, firstTexel, power, 0, 0);
        appendLists(grid.nodes, cells, lists);
        firstTexel += rows.length / 4;
        texels.push(rows);
    }
    header.push(...origin, cutoff, floor, 0, 0, 0);
    const most = Math.min(EXACT, maxSize * DATA_WIDTH);
    if (Math.max(firstTexel, cells.length, lists.length) > most)
        throw new RangeError(`${bake.fine.count} Gaussians: too many for a look-up in textures of ${maxSize} rows`);
    const short = Math.max(bake.fine.count, bake.coarse.count) <= 1 << 16;
    return {
        width: DATA_WIDTH,
        gaussians: padded(Float32Array, 4, [header, ...texels]),
        cells: padded(Uint32Array, 1, [cells]),
        lists: padded(short ? Uint16Array : Uint32Array, 1, [lists]),
    };
}

/** The middle of a bake that lies far from the world's origin, where float32 is too coarse; else the origin. */
function originOf({ fine, coarse }) {
    const low = [0, 0, 0].fill(Infinity), high = [0, 0, 0].fill(-Infinity);
    for (const { position } of [fine, coarse])
        position.forEach((x, i) => {
            low[i % 3] = Math.min(low[i % 3], x);
            high[i % 3] = Math.max(high[i % 3], x);
        });
    const middle = low.map((x, k) => (x + high[k]) / 2);
    const far = Math.hypot(...middle) > FAR * Math.hypot(...low.map((x, k) => high[k] - x));
    return far ? middle : [0, 0, 0];
}

/** A level relative to `origin`, with the scales that shaders can invert. */
function local(level, origin) {
    const position = level.position.map((x, i) => x - origin[i % 3]);
    return { ...level, position, scale: level.scale.map((x) => Math.max(x, SCALE_MIN)) };
}

function gaussianTexels(level) {
    const { count, position, rotation, scale, opacity } = level;
    const stride = 4 * texelCount(level), texels = new Float32Array(stride * count);
    for (let i = 0; i < count; ++i) {
        const at = stride * i, axes = axesOf(rotation.subarray(4 * i, 4 * i + 4));
        for (let j = 0; j < 3; ++j) {
            texels[at + j] = position[3 * i + j];
            texels[at + 4 + j] = axes[0][j] / scale[3 * i];
            texels[at + 8 + j] = axes[1][j] / scale[3 * i + 1];
        }
        texels[at + 3] = Math.min(opacity[i], 1);
        texels[at + 7] = 1 / scale[3 * i + 2];
    }
    writeLight(texels, level);
    return texels;
}

/** Appends the words of the nodes of one level to `cells`, and what they point to to `lists`. */
function appendLists(nodes, cells, lists) {
    const firstNode = cells.length;
    for (const { entries, child } of nodes) {
        cells.push(child || entries.length ? 2 * lists.length + (child ? 1 : 0) : 0);
        if (child) lists.push((firstNode + child) & 0xffff, (firstNode + child) >>> 16);
        if (child || entries.length) lists.push(entries.length);
        for (const entry of entries) lists.push(entry);
    }
}

/** The numbers of `parts` in whole rows of texels of that many channels. */
function padded(Kind, channels, parts) {
    const count = parts.reduce((sum, part) => sum + part.length, 0), row = DATA_WIDTH * channels;
    const result = new Kind(Math.max(Math.ceil(count / row), 1) * row);
    let at = 0;
    for (const part of parts) {
        result.set(part, at);
        at += part.length;
    }
    return result;
}
