/** Which Gaussians reach each cell of space: an octree of lists, as runtime/cell_lists.py builds it. */

const ROOTS = 8; // cells along the longest edge of the box, before any is split
const DEPTH_MAX = 20; // splits of a root; float32 coordinates within it have 24 bits
const SPLIT_MIN = 24; // Gaussians in a cell that is worth eight more
const SLACK = 1e-5; // of a root's edge and of an ellipsoid's radius; covers the rounding of float32 in shaders
const FINEST = 0.32; // edge of a leaf over the mean length of its Gaussians, over the fourth root of edge over median
const COARSEST = 0.5;
const FINENESS_COUNT = 15000; // it grows with the number of Gaussians in between
const HOISTED = 0.75; // the share of children with lists, above which what is in them is listed in the parent instead
const TINY = 1.2e-38; // the smallest normal float32

// What is known of an ellipsoid, SIZE numbers of one Float64Array; lengths are relative to `low` of the grid, m.
const BOUND = 3; // after the centre [3]: half the bounding box [3]
const WHITEN = 6; // axis i of coordinate j, times the shortest deviation over this one [3, 3]
const INVERSE = 15; // 1 / the square of the length of what coordinate j becomes [3]
const REACH = 18; // the shortest semi-axis
const SHORTNESS = 19; // 1 / the longest
const SIZE = 20;

const AXES = [0, 1, 2], { abs, max, min } = Math;

/**
 * Appends lists of all Gaussians that have weight somewhere to `lists`, and the nodes by which they are found to
 * `cells`, both as glsl/surface/lookup.glsl describes them. Gaussians end `radius` standard deviations out.
 *
 * Returns the grid whose cells are the first nodes: `size` [3] cubes of `edge` m from `low` [3] on.
 */
export function appendLists({ position, rotation, scale, opacity }, radius, cells, lists) {
    const used = [...opacity.keys()].filter((i) => opacity[i] > 0);
    const lengths = used.map((i) => radius * max(...scale.subarray(3 * i, 3 * i + 3)));
    if (!used.length) {
        cells.push(0);
        return { low: [0, 0, 0], edge: 1, size: [0, 0, 0] };
    }

    // The grid is around the centres, and most of what they reach.
    const sorted = Float64Array.from(lengths).sort(), half = sorted.length >> 1;
    const typical = (sorted[half] + sorted[sorted.length - 1 - half]) / 2;
    const farthest = (k, sign) => sign * used.reduce(
        (most, i, j) => max(most, sign * position[3 * i + k] + min(lengths[j], 2 * typical)), -Infinity);
    const low = AXES.map((k) => Math.fround(farthest(k, -1))), extent = AXES.map((k) => farthest(k, 1) - low[k]);
    const edge = Math.fround(max(...extent) / ROOTS), size = extent.map((x) => min(max(Math.ceil(x / edge), 1), ROOTS));

    const reach = radius * (1 + SLACK), bodies = new Float64Array(SIZE * used.length);
    used.forEach((index, i) => {
        const axes = axesOf(rotation.subarray(4 * index)), body = bodies.subarray(SIZE * i);
        const deviations = scale.subarray(3 * index, 3 * index + 3), shortest = min(...deviations);
        const whiten = axes.map((axis, k) => axis.map((x) => x * shortest / deviations[k]));
        body.set(AXES.map((k) => position[3 * index + k] - low[k]));
        body.set(AXES.map((k) => reach * Math.hypot(...axes.map((axis, j) => axis[k] * deviations[j]))), BOUND);
        body.set(whiten.flat(), WHITEN);
        body.set(AXES.map((k) => 1 / max(whiten.reduce((sum, row) => sum + row[k] ** 2, 0), TINY)), INVERSE);
        body.set([reach * shortest, 1 / lengths[i]], REACH);
    });

    const numbers = [...used.keys()], fineness = min(max(used.length / FINENESS_COUNT, FINEST), COARSEST);
    const seen = new Uint8Array(used.length), above = new Uint8Array(used.length);

    /** The tree below a cell: the bodies that reach it, of `members`, and of these the ones that it lists itself. */
    function grow(members, middle, half, depth) {
        const wide = half + SLACK * edge;
        members = members.filter((i) => near(bodies, SIZE * i, middle, wide) && meet(bodies, SIZE * i, wide));
        const wish = members.reduce((sum, i) => sum + bodies[SIZE * i + SHORTNESS], 0);
        if (members.length < SPLIT_MIN || depth === DEPTH_MAX || 2 * half * wish <= fineness * (2 * half / typical) ** 0.25 * members.length)
            return { members, list: members };
        const children = Array.from({ length: 8 }, (_, corner) =>
            grow(members, AXES.map((k) => middle[k] + (corner << k & 4 ? half : -half) / 2), half / 2, depth + 1));
        for (const child of children) for (const i of child.list) ++seen[i];
        const least = HOISTED * children.filter((child) => child.members.length).length;
        const list = members.filter((i) => seen[i] > least);
        for (const i of members) seen[i] = 0;
        return { members, list, children };
    }

    /** Writes a cell as the node `index`, without what is listed above it, and its children behind all others. */
    function emit(index, { list, children }) {
        const own = list.filter((i) => !above[i]), child = children ? cells.length : 0;
        cells[index] = child || own.length ? 2 * lists.length + (child ? 1 : 0) : 0;
        if (child) lists.push(child & 0xffff, child >>> 16);
        if (cells[index]) lists.push(own.length);
        for (const i of own) lists.push(used[i]);
        if (!child) return;
        cells.length += 8;
        for (const i of own) above[i] = 1;
        children.forEach((each, corner) => emit(child + corner, each));
        for (const i of own) above[i] = 0;
    }

    const first = cells.length, [, rows, columns] = size, outside = size[0] * rows * columns;
    cells.length += outside + 1;
    for (let i = 0; i < outside; ++i) {
        const cell = [i / (rows * columns) | 0, (i / columns | 0) % rows, i % columns];
        emit(first + i, grow(numbers, cell.map((x) => (x + 0.5) * edge), edge / 2, 0));
    }
    emit(first + outside, { list: numbers.filter((i) => AXES.some((k) => {
        const centre = bodies[SIZE * i + k], bound = bodies[SIZE * i + BOUND + k];
        return !(centre - bound > 0 && centre + bound < size[k] * edge);
    })) });
    return { low, edge, size };
}

/** The axes of a unit quaternion xyzw: the columns of its matrix (Shoemake 1985). */
export function axesOf([x, y, z, w]) {
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
        [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
        [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
    ];
}

const offset = new Float64Array(3); // from the middle of near()'s cube to the centre

/** Whether the box around an ellipsoid meets the cube around `middle`. */
function near(bodies, at, middle, half) {
    for (let k = 0; k < 3; ++k) {
        offset[k] = bodies[at + k] - middle[k];
        if (abs(offset[k]) - half > bodies[at + BOUND + k]) return false;
    }
    return true;
}

/**
 * Whether an ellipsoid meets the cube from whose middle it is `offset` away.
 *
 * It does if the cube's point nearest to the centre lies within. Else they are apart if a plane parts them. The best
 * plane is that across the gradient, at the cube's point nearest to the centre in standard deviations, of which a round
 * of descent along the axes comes close enough (Hildreth 1957); planes elsewhere part less, so no cube that is met is
 * lost.
 */
function meet(bodies, at, half) {
    const [x, y, z] = offset, reach = bodies[at + REACH], w = at + WHITEN;
    let u = 0, v = 0, t = 0, gap = 0; // what whitening makes of the way from the centre to the point
    const move = (k, step) => {
        u += bodies[w + k] * step;
        v += bodies[w + 3 + k] * step;
        t += bodies[w + 6 + k] * step;
    };
    const across = (k) => bodies[w + k] * u + bodies[w + 3 + k] * v + bodies[w + 6 + k] * t;
    const px = clamp(x, half), py = clamp(y, half), pz = clamp(z, half);
    move(0, px - x);
    move(1, py - y);
    move(2, pz - z);
    if (u * u + v * v + t * t <= reach * reach) return true;
    move(0, clamp(px - across(0) * bodies[at + INVERSE], half) - px);
    move(1, clamp(py - across(1) * bodies[at + INVERSE + 1], half) - py);
    move(2, clamp(pz - across(2) * bodies[at + INVERSE + 2], half) - pz);
    const gx = across(0), gy = across(1), gz = across(2);
    return !(-gx * x - gy * y - gz * z - half * (abs(gx) + abs(gy) + abs(gz)) > reach * Math.sqrt(u * u + v * v + t * t));
}

function clamp(x, half) {
    return x < -half ? -half : x > half ? half : x;
}
