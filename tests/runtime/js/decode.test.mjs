// Decodes the files of $VECTORS, which test_decode.py writes with what Python decodes from them.
import assert from "node:assert/strict";
import { existsSync, readFileSync, readdirSync } from "node:fs";
import { test } from "node:test";
import { pathToFileURL } from "node:url";

const { decode, FormatError } = await import(pathToFileURL(`${process.env.JS}/index.js`));
const folder = process.env.VECTORS;
const files = readdirSync(folder).filter((name) => name.endsWith(".gsgi"));

for (const name of files.filter((each) => !each.startsWith("refused")))
    test(name, () => {
        const bake = decode(readFileSync(`${folder}/${name}`)), expected = JSON.parse(readFileSync(`${folder}/${name}.json`));
        const { fine, coarse, scene, ...header } = bake;
        assert.deepEqual({ ...header, scene: `${scene}` }, expected);
        for (const [level, gaussians] of [["fine", fine], ["coarse", coarse]])
            for (const field of ["position", "rotation", "scale", "opacity", "sh", "slope"]) {
                const path = `${folder}/${name}.${level}.${field}`;
                const found = gaussians?.[field] ?? null;
                assert.equal(found !== null, existsSync(path), path);
                if (found) assert.ok(readFileSync(path).equals(Buffer.from(found.buffer)), path);
            }
    });

test("what Python refuses is refused", () => {
    const refused = files.filter((each) => each.startsWith("refused"));
    assert.ok(refused.length > 100);
    for (const name of refused)
        assert.throws(() => decode(readFileSync(`${folder}/${name}`)), FormatError, name);
});

test("every prefix is refused", () => {
    const whole = readFileSync(`${folder}/v5_surface.gsgi`);
    for (let length = 0; length < whole.length; ++length)
        assert.throws(() => decode(whole.subarray(0, length)), FormatError);
    assert.throws(() => decode(Buffer.concat([whole, Buffer.of(0)])), FormatError);
});
