/** Which Gaussians reach each cell of space: an octree of lists, as runtime/cell_lists.py builds it. */

const ROOTS = 16; // cells along the longest edge of the box at most, before any is split
const SMALLEST = 1e-6; // half edge of what is split, of a root's; float32 coordinates within it have 24 bits
const SPLIT_MIN = 16; // Gaussians in a cell that are worth eight more
const SLACK = 1e-5; // of a root's edge and of an ellipsoid's radius; covers the rounding of float32 in shaders
const SAVED = 16; // less octants, over SAVED_OF: the share of reads that listing in children saves
const SAVED_OF = 28;
const PRICED = 380; // Gaussians per sixteenth of a read that an entry is worth, of 4 to 16
const FLATTEST = 16; // longest over shortest axis in the tests

const AXES = [0, 1, 2], OCTANTS = [0, 1, 2, 3, 4, 5, 6, 7], { abs, max, min } = Math;

/**
 * Appends lists of all Gaussians that have weight somewhere to `lists`, and the nodes by which they are found to
 * `cells`, both as glsl/surface/lookup.glsl describes them. Gaussians end `radius` standard deviations out.
 *
 * Returns the grid whose cells are the first nodes, [low, edge, size]: `size` [3] cubes of `edge` m from `low` [3] on;
 * and behind these the first child.
 */
export function appendLists({ position, rotation, scale, opacity }, radius, coarse, cells, lists) {
    const used = [...opacity.keys()].filter((i) => opacity[i] > 0);
    const { length } = used, lengths = used.map((i) => radius * max(...scale.subarray(3 * i, 3 * i + 3)));
    if (!length) return [[0, 0, 0], 1, [0, 0, 0], cells.push(0)];
    // The coarse level is read only where the fine one has little weight: memory counts 16 times.
    const price = min(max(length / PRICED | 0, 4), 16) / (coarse ? 1 : 16);

    // The grid is around the centres, and most of what they reach.
    const typical = Float64Array.from(lengths).sort()[length >> 1];
    const [low, high] = [-1, 1].map((sign) => AXES.map((k) => Math.fround(sign * used.reduce(
        (most, i, j) => max(most, sign * position[3 * i + k] + min(lengths[j], 2 * typical)), -Infinity))));
    const extent = high.map((x, k) => x - low[k]);
    const roots = min(ROOTS, Math.ceil(Math.cbrt(length))), edge = Math.fround(max(...extent) / roots);
    const size = extent.map((x) => min(max(Math.ceil(x / edge), 1), roots));

    const reach = radius * (1 + SLACK), homes = {};
    // Of each ellipsoid, from `low` on, m: the centre, half the bounding box, the square of the shortest semi-axis,
    // and the inverse covariance, times the square of the shortest deviation.
    const bodies = used.map((index) => {
        const axes = axesOf(rotation.subarray(4 * index)), centre = AXES.map((k) => position[3 * index + k] - low[k]);
        const deviations = scale.subarray(3 * index, 3 * index + 3), shortest = min(...deviations);
        const unit = max(shortest, max(...deviations) / FLATTEST);
        const [u, v] = AXES.filter((k) => k !== deviations.indexOf(shortest)); // of its plane
        for (const a of AXES) for (const b of AXES) { // light is read at points one deviation apart
            const point = centre.map((x, k) =>
                x + (a - 1) * axes[u][k] * deviations[u] + (b - 1) * axes[v][k] * deviations[v]);
            (homes[point.map((x) => x / edge | 0)] ??= []).push(point);
        }
        return [
            ...centre, ...AXES.map((k) => reach * Math.hypot(...axes.map((axis, j) => axis[k] * deviations[j]))),
            (reach * unit) ** 2, ...AXES.flatMap((j) => AXES.map((k) =>
                axes.reduce((sum, axis, a) => sum + axis[j] * axis[k] * min(unit / deviations[a], 1) ** 2, 0))),
        ];
    });
    const below = used.map(() => 0), above = [...below], numbers = used.map((_, i) => i);

    /**
     * The tree below a cell: of each of `members`, which come near, the octants that it reaches, or 0 if it is not
     * listed here, and its cost; and the children.
     */
    function grow(members, points, middle, half) {
        const crowds = OCTANTS.map(() => []);
        for (const point of points)
            crowds[4 * (point[0] >= middle[0]) + 2 * (point[1] >= middle[1]) + (point[2] >= middle[2])].push(point);
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
            const free = crowd * (SAVED - 1 - more) > price * SAVED_OF * more;
            return [i, octants, crowd + price, free];
        });
        const pushed = pairs.filter((pair) => pair[3]);
        if (pushed.length >= SPLIT_MIN && half > SMALLEST * edge) {
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
            const near = (i) => abs(bodies[i][k] - (x + 0.5) * edge) - edge * (0.5 + SLACK) <= bodies[i][3 + k];
            plant(members.filter(near), [...cell, x]);
        }
    }

    let index = cells.length;
    const child = index + size[0] * size[1] * size[2] + 1;
    cells.length = child;
    plant(numbers, []);
    const sticksOut = (i) => AXES.some((k) =>
        !(abs(bodies[i][k] - size[k] * edge / 2) + bodies[i][3 + k] < size[k] * edge / 2));
    emit(index, [numbers.filter(sticksOut).map((i) => [i, 255])]);
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
 * They do not if a plane parts them: one across an axis, or across the gradient of the distance in standard deviations,
 * at the cube's middle or at its point nearest to the centre.
 */
function meet(body, middle, half) {
    const x = body[0] - middle[0], y = body[1] - middle[1], z = body[2] - middle[2];
    const parted = (u, v, w) => {
        const a = body[7] * u + body[8] * v + body[9] * w, b = body[10] * u + body[11] * v + body[12] * w;
        const c = body[13] * u + body[14] * v + body[15] * w;
        return a * x + b * y + c * z - half * (abs(a) + abs(b) + abs(c)) > Math.sqrt(body[6] * (a * u + b * v + c * w));
    };
    const beyond = (k) => k - max(-half, min(k, half));
    return abs(x) - half <= body[3] && abs(y) - half <= body[4] && abs(z) - half <= body[5]
        && !parted(x, y, z) && !parted(beyond(x), beyond(y), beyond(z));
}
