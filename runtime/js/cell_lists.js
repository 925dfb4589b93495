/** Which Gaussians reach each cell of space: an octree of lists, as runtime/cell_lists.py builds it. */

const { abs, ceil, floor, max, min, sqrt } = Math;

const ROOTS = 8; // cells along the longest edge of the box, before any is split
const DEPTH_MAX = 20; // splits of a root; float32 coordinates within it have 24 bits
const SPLIT_MIN = 12; // sheets in a cell that is worth eight more
const SLACK = 1e-5; // of a root's edge and of an ellipsoid's radius; covers the rounding of float32 in shaders
const FINEST = 0.3, COARSEST = 0.4, FINEST_COUNT = 2600; // edge of a leaf over the Gaussians' mean in-plane radius
const SHEET = 0.7; // standard deviations around the centre
const TINY = 1.2e-38; // the smallest normal float32
const CORNERS = Array.from({ length: 8 }, (_, i) => [(i & 4) / 2 - 1, (i & 2) - 1, 2 * (i & 1) - 1]);

/**
 * Lists of all Gaussians that have weight somewhere, by cells; they end `radius` standard deviations out.
 *
 * `nodes` begins with the cells of a grid, z fastest: `size` [3] cubes of `edge` m from `low` [3] on; the next one is
 * for all points outside of it. A node lists Gaussians in `entries`, and with `child` > 0 it is split into the eight
 * nodes from there on: child + 4 x + 2 y + z, with 0 or 1 for the lower or upper half. A point is reached by no others
 * than those in the lists of the nodes around it.
 */
export function cellLists(gaussians, radius) {
    const used = [];
    for (let i = 0; i < gaussians.count; ++i)
        if (gaussians.opacity[i] > 0) used.push(i);
    if (!used.length) return { low: [0, 0, 0], edge: 1, size: [0, 0, 0], nodes: [{ entries: [], child: 0 }] };
    const grid = gridAround(gaussians, used, radius), { edge, size } = grid;
    const bodies = ellipsoids(gaussians, used, radius, grid.low), reach = radius * (1 + SLACK), slack = SLACK * edge;
    const fineness = min(max(FINEST * sqrt(used.length / FINEST_COUNT), FINEST), COARSEST);

    const outside = used.filter((_, i) => [0, 1, 2].some((k) => {
        const centre = bodies[SIZE * i + k], bound = bodies[SIZE * i + BOUND + k];
        return !(centre - bound > 0 && centre + bound < size[k] * edge);
    }));
    const roots = rootCells(bodies, radius, grid);
    const nodes = Array.from({ length: roots.length + 1 }, () => ({ entries: outside, child: 0 }));
    roots.forEach((root, i) => {
        const cell = descend({ bodies, reach, slack, fineness }, root, edge / 2, 0);
        emit(nodes, i, cell, new Uint8Array(root.members.length), used);
    });
    return { ...grid, nodes };
}

/** Lowest corner, edge and number of cells of a grid around the centres, and most of what they reach. */
function gridAround({ position, scale }, used, radius) {
    const bounds = used.map((i) => radius * max(scale[3 * i], scale[3 * i + 1], scale[3 * i + 2]));
    const sorted = Float64Array.from(bounds).sort(), half = sorted.length >> 1;
    const margin = sorted[half] + sorted[sorted.length - 1 - half]; // twice the median
    const low = [], high = [];
    for (let k = 0; k < 3; ++k) {
        let centreLow = Infinity, centreHigh = -Infinity, reachLow = Infinity, reachHigh = -Infinity;
        used.forEach((i, j) => {
            const x = position[3 * i + k];
            centreLow = min(centreLow, x);
            centreHigh = max(centreHigh, x);
            reachLow = min(reachLow, x - bounds[j]);
            reachHigh = max(reachHigh, x + bounds[j]);
        });
        low.push(Math.fround(max(reachLow, centreLow - margin)));
        high.push(min(reachHigh, centreHigh + margin));
    }
    const edge = Math.fround(max(...high.map((x, k) => x - low[k])) / ROOTS);
    return { low, edge, size: high.map((x, k) => min(max(ceil((x - low[k]) / edge), 1), ROOTS)) };
}

// What tests need of a Gaussian, SIZE numbers of one Float64Array; lengths are relative to `low` of the grid, m.
const BOUND = 3; // after the centre [3]: half the bounding box [3]
const METRIC = 6; // transpose(whiten) whiten: xx, xy, xz, yy, yz, zz
const WHITEN = 12; // axis i of coordinate j, times the shortest deviation over this one; the shortest axis first [3, 3]
const WIDTH = 21; // sums of the magnitudes of its rows: half of what it makes of a cube of half edge 1 [3]
const SHORTEST = 24, IN_PLANE = 25; // the shortest deviation; the mean of the two others' reach
const SIZE = 26;

function ellipsoids({ position, rotation, scale }, used, radius, low) {
    const bodies = new Float64Array(SIZE * used.length), reach = radius * (1 + SLACK);
    used.forEach((index, number) => {
        const at = SIZE * number, matrix = axesOf(rotation.subarray(4 * index, 4 * index + 4));
        const order = [0, 1, 2].sort((a, b) => scale[3 * index + a] - scale[3 * index + b]);
        const deviation = order.map((k) => scale[3 * index + k]), metric = [0, 0, 0, 0, 0, 0];
        for (let j = 0; j < 3; ++j) {
            bodies[at + j] = position[3 * index + j] - low[j];
            bodies[at + BOUND + j] = reach * Math.hypot(...order.map((k, i) => matrix[k][j] * deviation[i]));
        }
        order.forEach((k, i) => {
            const [x, y, z] = matrix[k].map((value) => value * deviation[0] / deviation[i]);
            bodies.set([x, y, z], at + WHITEN + 3 * i);
            bodies[at + WIDTH + i] = abs(x) + abs(y) + abs(z);
            [x * x, x * y, x * z, y * y, y * z, z * z].forEach((value, j) => { metric[j] += value; });
        });
        bodies.set(metric, at + METRIC);
        bodies[at + SHORTEST] = deviation[0];
        bodies[at + IN_PLANE] = radius * 2 / (1 / deviation[1] + 1 / deviation[2]);
    });
    return bodies;
}

/** The axes of a unit quaternion xyzw: the columns of its matrix (Shoemake 1985). */
export function axesOf([x, y, z, w]) {
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
        [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
        [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
    ];
}

/** The grid's cells, z fastest: their middles, and the bodies that reach them. */
function rootCells(bodies, radius, { edge, size }) {
    const cells = [], half = edge * (0.5 + SLACK), reach = radius * (1 + SLACK);
    for (let x = 0; x < size[0]; ++x)
        for (let y = 0; y < size[1]; ++y)
            for (let z = 0; z < size[2]; ++z)
                cells.push({ middle: [x, y, z].map((i) => (i + 0.5) * edge), members: [], parents: [] });
    for (let at = 0; at < bodies.length; at += SIZE) {
        const from = [], to = [];
        for (let k = 0; k < 3; ++k) {
            const bound = bodies[at + BOUND + k] + SLACK * edge, last = size[k] - 1;
            from.push(min(max(floor((bodies[at + k] - bound) / edge), 0), last));
            to.push(min(max(floor((bodies[at + k] + bound) / edge), 0), last));
        }
        for (let x = from[0]; x <= to[0]; ++x)
            for (let y = from[1]; y <= to[1]; ++y)
                for (let z = from[2]; z <= to[2]; ++z) {
                    const cell = cells[(x * size[1] + y) * size[2] + z];
                    if (meet(bodies, at, ...cell.middle, half, reach)) cell.members.push(at);
                }
    }
    return cells;
}

/**
 * The tree below a cell. `members` are the bodies that reach it, and `parents` their places in the parent's members.
 * In the result `listed` marks what the cell lists itself: all of a leaf, or what all children that sheets cross list.
 */
function descend(tests, { middle, members, parents }, half, depth) {
    const { bodies, reach, slack, fineness } = tests;
    const { crossed, split } = judge(bodies, members, middle, half, fineness);
    const listed = new Uint8Array(members.length);
    if (!split || depth === DEPTH_MAX) return { members, parents, crossed, listed: listed.fill(1), children: null };
    const quarter = half / 2, children = [];
    for (const corner of CORNERS) {
        const [x, y, z] = [0, 1, 2].map((k) => middle[k] + quarter * corner[k]);
        const child = { middle: [x, y, z], members: [], parents: [] };
        for (let place = 0; place < members.length; ++place)
            if (meet(bodies, members[place], x, y, z, quarter + slack, reach)) {
                child.members.push(members[place]);
                child.parents.push(place);
            }
        children.push(descend(tests, child, quarter, depth + 1));
    }
    const crossedChildren = children.filter((child) => child.crossed);
    const found = new Uint8Array(members.length);
    for (const child of crossedChildren)
        for (let i = 0; i < child.parents.length; ++i) found[child.parents[i]] += child.listed[i];
    for (let i = 0; i < found.length; ++i) listed[i] = found[i] > 0 && found[i] === crossedChildren.length;
    return { members, parents, crossed, listed, children };
}

/** Writes a cell to `nodes` at `index`, and its children behind all others. `above`: what is listed around it. */
function emit(nodes, index, { members, listed, children }, above, used) {
    const entries = [];
    members.forEach((body, i) => { if (listed[i] && !above[i]) entries.push(used[body / SIZE]); });
    const child = children ? nodes.length : 0;
    nodes[index] = { entries, child };
    if (!children) return;
    nodes.push(...children);
    children.forEach((each, corner) => {
        const known = Uint8Array.from(each.parents, (place) => above[place] | listed[place]);
        emit(nodes, child + corner, each, known, used);
    });
}

/** Whether sheets cross a cell, and whether it is large for the Gaussians of these sheets. */
function judge(bodies, members, middle, half, fineness) {
    const [mx, my, mz] = middle;
    let sheets = 0, crossing = 0, wish = 0;
    for (let i = 0; i < members.length; ++i) {
        const at = members[i], w = at + WHITEN;
        const x = bodies[at] - mx, y = bodies[at + 1] - my, z = bodies[at + 2] - mz;
        const through = abs(x * bodies[w] + y * bodies[w + 1] + z * bodies[w + 2]);
        if (through > half * bodies[at + WIDTH]) continue;
        sheets += 1;
        const first = abs(x * bodies[w + 3] + y * bodies[w + 4] + z * bodies[w + 5]);
        const second = abs(x * bodies[w + 6] + y * bodies[w + 7] + z * bodies[w + 8]);
        const u = max(first - half * bodies[at + WIDTH + 1] / 2, 0);
        const v = max(second - half * bodies[at + WIDTH + 2] / 2, 0);
        if (u * u + v * v > (SHEET * bodies[at + SHORTEST]) ** 2) continue;
        // Where points lie on a sheet, as many more Gaussians than reach a point are listed as the cell's edge is
        // longer than their mean in-plane radius.
        crossing += 1;
        wish += 1 / bodies[at + IN_PLANE];
    }
    return { crossed: crossing > 0, split: sheets >= SPLIT_MIN && 2 * half * wish > fineness * crossing };
}

/**
 * Whether an ellipsoid meets the cube around `middle`.
 *
 * They are apart if a plane parts them. The best plane is that across the gradient, at the cube's point nearest to the
 * centre in standard deviations. Two rounds of descent along the axes find it nearly always (Hildreth 1957); planes
 * elsewhere part less, so no cube that is met is lost.
 */
function meet(bodies, at, mx, my, mz, half, reach) {
    const x = bodies[at] - mx, y = bodies[at + 1] - my, z = bodies[at + 2] - mz;
    const dx = abs(x) - half, dy = abs(y) - half, dz = abs(z) - half;
    if (dx > bodies[at + BOUND] || dy > bodies[at + BOUND + 1] || dz > bodies[at + BOUND + 2]) return false;
    if (dx <= 0 && dy <= 0 && dz <= 0) return true; // the centre lies within
    const xx = bodies[at + METRIC], xy = bodies[at + METRIC + 1], xz = bodies[at + METRIC + 2];
    const yy = bodies[at + METRIC + 3], yz = bodies[at + METRIC + 4], zz = bodies[at + METRIC + 5];
    let px = clamp(x, half), py = clamp(y, half), pz = clamp(z, half);
    let gx = xx * (px - x) + xy * (py - y) + xz * (pz - z);
    let gy = xy * (px - x) + yy * (py - y) + yz * (pz - z);
    let gz = xz * (px - x) + yz * (py - y) + zz * (pz - z);
    for (let round = 0; round < 2; ++round) {
        let moved = clamp(px - gx / max(xx, TINY), half), step = moved - px;
        px = moved, gx += xx * step, gy += xy * step, gz += xz * step;
        moved = clamp(py - gy / max(yy, TINY), half), step = moved - py;
        py = moved, gx += xy * step, gy += yy * step, gz += yz * step;
        moved = clamp(pz - gz / max(zz, TINY), half), step = moved - pz;
        pz = moved, gx += xz * step, gy += yz * step, gz += zz * step;
    }
    let square = 0;
    gx = gy = gz = 0;
    for (let row = at + WHITEN; row < at + WIDTH; row += 3) {
        const ax = bodies[row], ay = bodies[row + 1], az = bodies[row + 2];
        const white = ax * (px - x) + ay * (py - y) + az * (pz - z);
        gx += ax * white, gy += ay * white, gz += az * white;
        square += white * white;
    }
    const gap = -(gx * x + gy * y + gz * z) - half * (abs(gx) + abs(gy) + abs(gz));
    return !(gap > reach * bodies[at + SHORTEST] * sqrt(square));
}

function clamp(x, half) {
    return x < -half ? -half : x > half ? half : x;
}
