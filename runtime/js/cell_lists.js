/** Which Gaussians reach each cell of space: an octree of lists, as runtime/cell_lists.py builds it. */

const ROOTS = 16; // cells along the longest edge of the box at most, before any is split
const SMALLEST = 1e-6; // half edge of what is split, of a root's; float32 coordinates within it have 24 bits
const SPLIT_MIN = 16; // Gaussians in a cell that are worth eight more
const PAIRS = 1e6, PAIRS_EACH = 64; // most pairs of a Gaussian and a cell that is split: in all, and more for each
const SLACK = 1e-5; // of a root's edge and of an ellipsoid's radius; covers the rounding of float32 in shaders
const SAVED = 16; // less octants, over SAVED_OF: the share of reads that listing in children saves
const SAVED_OF = 28;
const PRICED = 240; // Gaussians per sixteenth of a read that an entry is worth, of 7 to 28
const FLATTEST = 16; // longest over shortest axis in the tests

const STEPS = [-1.2, -0.4, 0.4, 1.2]; // deviations to points where light is read, in the plane of a Gaussian
const AXES = [0, 1, 2], OCTANTS = [0, 1, 2, 3, 4, 5, 6, 7], { abs, ceil, fround, max, min } = Math;

/**
 * Appends lists of all Gaussians that have weight somewhere to `lists`, and the nodes by which they are found to
 * `cells`, both as glsl/surface/lookup.glsl describes them. Gaussians end `radius` standard deviations out.
 *
 * Returns the grid whose cells are the first nodes, [low, edge, size]: `size` [3] cubes of `edge` m from `low` [3] on;
 * and behind these the first child.
 */
export function appendLists({ position, rotation, scale, opacity }, radius, coarse, cells, lists) {
    const used = [...opacity.keys()].filter((i) => opacity[i] > 0);
    const { length } = used, scaleOf = (i) => scale.subarray(3 * i, 3 * i + 3);
    const lengths = used.map((i) => radius * max(...scaleOf(i)));
    if (!length) return [[0, 0, 0], 1, [0, 0, 0], cells.push(0)];
    // The coarse level is read only where the fine one has little weight: memory counts 16 times.
    const price = min(max(length / PRICED | 0, 7), 28) / (coarse ? 1 : 16);

    // The grid is around the centres, and most of what they reach.
    const typical = [...lengths].sort((a, b) => a - b)[length >> 1];
    const [low, high] = [-1, 1].map((sign) => AXES.map((k) => fround(sign * used.reduce(
        (most, i, j) => max(most, sign * position[3 * i + k] + min(lengths[j], 2 * typical)), -Infinity))));
    const extent = high.map((x, k) => x - low[k]);
    let edge, size, spare = PAIRS + PAIRS_EACH * length, roots = min(ROOTS, ceil(length ** (1 / 3)));
    do {
        edge = fround(max(...extent) / roots);
        size = extent.map((x) => min(ceil(x / edge) || 1, roots));
        roots = ceil(roots / 2);
    } while (lengths.reduce((pairs, reach) => // large ones would fill all cells
        pairs + size.reduce((cells, most) => cells * min(2 * reach / edge + 1, most), 1), 0) > spare);

    const reach = radius * (1 + SLACK), homes = {};
    // Of each ellipsoid, from `low` on, m: the centre, half the bounding box, the square of the shortest semi-axis,
    // and the inverse covariance, times the square of the shortest deviation.
    const bodies = used.map((index) => {
        const axes = axesOf(rotation.subarray(4 * index)), centre = AXES.map((k) => position[3 * index + k] - low[k]);
        const deviations = scaleOf(index), shortest = min(...deviations);
        const unit = max(shortest, max(...deviations) / FLATTEST);
        const [u, v] = AXES.filter((k) => k !== deviations.indexOf(shortest)); // of its plane
        for (const a of STEPS) for (const b of STEPS) {
            const point = centre.map((x, k) => x + a * axes[u][k] * deviations[u] + b * axes[v][k] * deviations[v]);
            (homes[point.map((x) => x / edge | 0)] ??= []).push(point);
        }
        return [
            ...centre, ...AXES.map((k) => reach * Math.hypot(...axes.map((axis, j) => axis[k] * deviations[j]))),
            (reach * unit) ** 2, ...AXES.flatMap((j) => AXES.slice(j).map((k) =>
                axes.reduce((sum, axis, a) => sum + axis[j] * axis[k] * min(unit / deviations[a], 1) ** 2, 0))),
        ];
    });
    const below = used.map(() => 0), above = [], numbers = [...used.keys()];

    /**
     * The tree below a cell: of each of `members`, which come near, the octants that it reaches, or 0 if it is not
     * listed here, and its cost; and the children.
     */
    function grow(members, points, middle, half) {
        const crowds = OCTANTS.map(() => []);
        for (const point of points)
            crowds[middle.reduce((octant, x, k) => 2 * octant + (point[k] >= x), 0)].push(point);
        half /= 2;
        const middles = OCTANTS.map((o) => middle.map((x, k) => o << k & 4 ? x + half : x - half));
        let children;
        const pairs = members.map((i) => {
            let octants = 0, crowd = 0, more = -1;
            for (let o = 0; o < 8; ++o) if (meet(bodies[i], middles[o], half + SLACK * edge)) {
                octants |= 1 << o;
                crowd += crowds[o].length;
                ++more;
            }
            return [i, octants, crowd + price, crowd * (SAVED - 1 - more) > price * SAVED_OF * more];
        });
        const pushed = pairs.filter((pair) => pair[3]);
        if (pushed.length >= SPLIT_MIN && half > SMALLEST * edge && (spare -= members.length) > 0) {
            children = middles.map((each, o) => grow(
                pushed.filter((pair) => pair[1] >> o & 1).map(([i]) => i), crowds[o], each, half));
            for (const [each] of children) for (const [i, , cost] of each) below[i] += cost;
        }
        for (const pair of pairs) {
            const [i, , here, free] = pair;
            if (children && free && below[i] < here) {
                pair[1] = 0;
                pair[2] = below[i];
            }
            below[i] = 0;
        }
        return [pairs, children];
    }

    /** Writes a cell as the node `index`, without what is listed above it, and its children behind all others. */
    function emit(index, [pairs, children]) {
        const own = pairs.filter(([i, octants]) => octants && !above[i]), next = cells.length, count = own.length;
        if (!children && !count) return;
        cells[index] = 2 * lists.length + !!children;
        if (children) lists.push((next - child) / 8);
        lists.push(count);
        const place = lists.length;
        for (let bit = 0; bit < 8 * count; ++bit)
            lists[place + (bit >> 4)] |= (own[bit % count][1] >> bit / count & 1) << bit % 16;
        for (const [i] of own) lists.push(used[i]);
        if (!children) return;
        cells.length += 8;
        for (const [i] of own) above[i] = 1;
        children.forEach((each, o) => emit(next + o, each));
        for (const [i] of own) above[i] = 0;
    }

    /** Writes the cells of the grid whose first coordinates are `cell`, of which `members` come near. */
    function plant(members, cell) {
        const k = cell.length;
        if (k > 2) return emit(index++, grow(members, homes[cell] ?? [], cell.map((x) => (x + 0.5) * edge), edge / 2));
        for (let x = 0; x < size[k]; ++x) {
            const near = members.filter((i) =>
                abs(bodies[i][k] - (x + 0.5) * edge) - edge * (0.5 + SLACK) <= bodies[i][3 + k]);
            plant(near, [...cell, x]);
        }
    }

    let index = cells.length;
    const child = index + size[0] * size[1] * size[2] + 1;
    cells.length = child;
    plant(numbers, []);
    const sticksOut = numbers.filter((i) => size.some((count, k) =>
        !(abs(bodies[i][k] - count * edge / 2) + bodies[i][3 + k] < count * edge / 2)));
    emit(index, [sticksOut.map((i) => [i, 255])]);
    return [low, edge, size, child];
}

/** The axes of a unit quaternion xyzw: the columns of its matrix (Shoemake 1985). */
export function axesOf([x, y, z, w]) {
    return [
        [1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)],
        [2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)],
        [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)],
    ];
}

/**
 * Whether an ellipsoid meets the cube around `middle`.
 *
 * They do not if a plane parts them: one across an axis, or across the gradient of the distance in standard deviations.
 * The latter is taken at a point of the cube where that distance is near its least: after one round of descent along the
 * axes, from the point nearest to the ellipsoid's centre.
 */
function meet(body, middle, half) {
    const x = body[0] - middle[0], y = body[1] - middle[1], z = body[2] - middle[2];
    const within = (t, centre) => max(centre - half, min(t, centre + half));
    let v = within(0, y), w = within(0, z);
    if (abs(x) - half > body[3] || abs(v) > body[4] || abs(w) > body[5]) return false;
    const u = within(-(body[8] * v + body[9] * w) / body[7], x);
    v = within(-(body[8] * u + body[11] * w) / body[10], y);
    w = within(-(body[9] * u + body[11] * v) / body[12], z);
    const a = body[7] * u + body[8] * v + body[9] * w, b = body[8] * u + body[10] * v + body[11] * w;
    const c = body[9] * u + body[11] * v + body[12] * w;
    return !(a * x + b * y + c * z - half * (abs(a) + abs(b) + abs(c)) > Math.sqrt(body[6] * (a * u + b * v + c * w)));
}
