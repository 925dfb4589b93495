// Decodes the files of $VECTORS, which test_decode.py writes with what Python decodes from them.
import assert from "node:assert/strict";
import { existsSync, readFileSync, readdirSync } from "node:fs";
import { test } from "node:test";
import { pathToFileURL } from "node:url";

const { decode, FormatError, groupNames, weighted } = await import(pathToFileURL(`${process.env.JS}/index.js`));
const { openStreams } = await import(pathToFileURL(`${process.env.JS}/integers.js`));
const folder = process.env.VECTORS;
const files = readdirSync(folder).filter((name) => name.endsWith(".gsgi"));

/** The fields of both levels are those of the files that Python wrote. */
function same(name, levels, fields) {
    for (const level of ["fine", "coarse"])
        for (const field of fields) {
            const path = `${folder}/${name}.${level}.${field}`, found = levels[level]?.[field] ?? null;
            assert.equal(found !== null, existsSync(path), path);
            if (found) assert.ok(readFileSync(path).equals(Buffer.from(found.buffer)), path);
        }
}

for (const name of files.filter((each) => !each.startsWith("refused")))
    test(name, () => {
        const bake = decode(readFileSync(`${folder}/${name}`)), expected = JSON.parse(readFileSync(`${folder}/${name}.json`));
        const { fine, coarse, scene, groups, ...header } = bake, { groups: named, weights, ...stated } = expected;
        assert.deepEqual({ ...header, scene: `${scene}` }, stated);
        assert.deepEqual(groups.map((group) => ({ name: group.name, patterns: group.patterns })), named);
        same(name, { fine, coarse }, ["position", "rotation", "scale", "opacity", "sh", "slope", "relief"]);
        for (const group of groups) same(`${name}.${group.name}`, group, ["sh", "slope"]);
        weights.forEach((each, i) => same(`${name}.weighted${i}`, weighted(bake, each), ["sh", "slope", "relief"]));
        if (groups.length) assert.equal(weighted(bake, { base: [1, 1, 1] }), bake);
    });

test("what Python refuses is refused", () => {
    const refused = files.filter((each) => each.startsWith("refused"));
    assert.ok(refused.length > 100);
    for (const name of refused)
        assert.throws(() => decode(readFileSync(`${folder}/${name}`)), FormatError, name);
});

test("a file of another version says so", () => {
    const file = readFileSync(`${folder}/empty.gsgi`), old = Uint8Array.from(file);
    old[4] -= 1;
    assert.throws(() => decode(old), new RegExp(`byte 4: not version ${file[4]}$`));
});

test("weights that cannot be are refused", () => {
    const bake = decode(readFileSync(`${folder}/light_groups.gsgi`));
    assert.deepEqual(groupNames(bake), ["base", "lamps", "sky"]);
    assert.throws(() => weighted(bake, { lamp: 1 }), /RangeError: no light group "lamp": there is base, lamps, sky$/);
    for (const weight of [-1, NaN, 2e15, [1, 1], [1, 1, -1], "x", undefined])
        assert.throws(() => weighted(bake, { lamps: weight }), /RangeError: the weight of "lamps"/);
    const plain = decode(readFileSync(`${folder}/empty.gsgi`));
    assert.deepEqual(groupNames(plain), []);
    assert.throws(() => weighted(plain, { base: 0.5 }), /there is none$/);
});

test("every prefix is refused", () => {
    const whole = readFileSync(`${folder}/v6_surface.gsgi`);
    for (let length = 0; length < whole.length; ++length)
        assert.throws(() => decode(whole.subarray(0, length)), FormatError);
    assert.throws(() => decode(Buffer.concat([whole, Buffer.of(0)])), FormatError);
});

test("what is no file of ours is said to be none", () => {
    const page = new TextEncoder().encode(`<!doctype html>${" ".repeat(99)}`);
    assert.throws(() => decode(page), /^FormatError: byte 0: no .gsgi file$/);
});

test("a prefix of millions of bits is refused", () => {
    const size = 4 << 20, bytes = new Uint8Array(2 * size + 10);
    bytes.set([0x20, 0, 0x80, 0x80, 0x80, 0x02]); // exponential, base 0, `size` bytes of prefixes
    bytes[5 + size] = 0x80; // the only one ends at their end
    assert.throws(() => openStreams(bytes, 0, bytes.length).read(1), FormatError);
});
