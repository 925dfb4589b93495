/** Weights of light groups: the sum of the parts of a bake's light, as runtime/file/FORMAT.md has it. */

export const BASE = "base"; // the group of all lights in no other
const f = Math.fround;

/** The names that weights of a bake may have, "base" first: that of all lights in no other group. */
export function groupNames({ groups }) {
    const names = groups.map(({ name }) => name).filter((name) => name !== BASE);
    return groups.length ? [BASE, ...names] : names;
}

/**
 * The bake with the light of each of its groups multiplied by its weight, a number or three of linear Rec.709, by name:
 * `{ lamps: 0.2, sun: [1, 0.9, 0.8] }`. Groups that are left out have 1. With ones it is the bake itself.
 *
 * The numbers are those of Python, to the last bit. Throws RangeError for an unknown group, and for weights that are
 * not from 0 to 1e15.
 */
export function weighted(bake, weights) {
    const names = groupNames(bake), factors = new Map(names.map((name) => [name, [1, 1, 1]]));
    for (const [name, weight] of Object.entries(weights)) {
        const three = (weight?.[Symbol.iterator] ? [...weight] : [weight, weight, weight]).map(f);
        if (!factors.has(name)) throw new RangeError(`no light group "${name}": there is ${names.join(", ") || "none"}`);
        if (three.length !== 3 || !three.every((each) => each >= 0 && each <= 1e15))
            throw new RangeError(`the weight of "${name}" must be one or three numbers from 0 to 1e15`);
        factors.set(name, three);
    }
    const own = bake.groups.map(({ name }) => factors.get(name));
    if (own.flat().every((each) => each === 1)) return bake;
    // The groups alone do not add up to the bake exactly: light must not jump when a weight leaves 1.
    const least = [0, 1, 2].map((c) => Math.min(...own.map((factor) => factor[c])));
    const all = [least, ...own.map((factor) => factor.map((each, c) => f(each - least[c])))];
    const sumOf = (level) => sum([bake, ...bake.groups].map((part) => part[level]), all);
    return { ...bake, fine: sumOf("fine"), coarse: sumOf("coarse") };
}

/** A level, the first of `parts`, whose colours are the sum of those of all, each multiplied by its of `factors`. */
function sum(parts, factors) {
    const [level] = parts, sh = new Float32Array(level.sh.length), stride = sh.length / level.count;
    parts.forEach((part, p) => part.sh.forEach((value, i) => { sh[i] += f(factors[p][i % 3] * value); }));
    const relief = level.relief?.map((value, i) => { // follows the colours
        const at = (i / 9 | 0) * stride + i % 3, before = level.sh[at];
        return value * (before > 0 ? f(sh[at] / before) : 0);
    });
    // Slopes that change the sum as those of the parts do theirs, as far as one pair for all channels can: least squares.
    const dot = (a, b) => a.map((x, c) => x * b[c]).reduce((sum, product) => f(sum + product));
    const slope = level.slope?.map((_, i) => {
        const first = (i >> 1) * stride, constant = sh.subarray(first, first + 3), gradient = new Float32Array(3);
        parts.forEach((part, p) =>
            factors[p].forEach((factor, c) => { gradient[c] += f(part.slope[i] * f(factor * part.sh[first + c])); }));
        return dot(gradient, constant) / dot(constant, constant) || 0; // both are 0 where there is no light
    });
    return { ...level, sh, slope, relief };
}
