// Writes what this folder takes from elsewhere:   node build.mjs [--check]
//   shaders.js, page/shaders.js         from glsl/
//   page/three.js, page/three.LICENSE   from three.js, bundled by esbuild: after `npm ci`, else they stay as they are
// With --check nothing is written, and the exit code says whether the files are what they would be.
import { existsSync, readFileSync, writeFileSync } from "node:fs";

const GLSL = new URL("../../glsl/", import.meta.url);
const NOTE = "// Written by build.mjs from glsl/. Do not edit.\n";
const CONSTANTS = ["DATA_WIDTH", "HALF_MAX", "LEVEL_TEXELS", "SCALE_MIN", "SH_C0"];

/** Source of glsl/`name` with each include expanded once. */
function expanded(name, seen = new Set()) {
    if (seen.has(name)) return "";
    seen.add(name);
    const text = readFileSync(new URL(name, GLSL), "utf8");
    return text.replace(/^#include "(.+)"$/gm, (_, other) => expanded(other, seen));
}

/** Without comments and empty lines. */
function bare(source) {
    return source.replace(/ *\/\/.*$/gm, "").replace(/\n+/g, "\n");
}

/** Without the space that only people need. */
function packed(source) {
    const lines = source.replace(/^ +/gm, "").replace(/ +/g, " ").trim().split("\n");
    const code = (line) => line.replace(/ ?([-+*\/%=<>?!:,;{}()|&]) ?/g, "$1");
    return lines.map((line) => (line.startsWith("#") ? `${line}\n` : code(line))).join("").replace(/(?<=[^\n])#/g, "\n#");
}

/** With the same type only before the first of declarations that follow each other. */
function merged(source) {
    const pair = /((?:^|[;{}])(?:highp )?(vec[234]|int|float) [^;{}]*);\2 /;
    while (pair.test(source)) source = source.replace(pair, "$1,");
    return source;
}

/** With `#if SH_DEGREE > N` resolved. */
function resolved(source) {
    const degree = Number(/#define SH_DEGREE (\d)/.exec(source)[1]);
    return source.replace(/#if SH_DEGREE > (\d)\n([^]*?)#endif\n/g, (_, least, body) => (degree > least ? body : ""));
}

const COUNTS = ["FINE_SH_COUNT", "COARSE_SH_COUNT", "RELIEF_COUNT"];
const TEXTURES = ["gaussians", "cells", "lists"];

const DEFINE = /^#define (\w+).*\n/gm;
const FUNCTION = /^\w+ (\w+)\([^)]*\) \{\n[^]*?^\}\n/gm;
const STRUCT = /^struct (\w+) \{\n[^]*?^\};\n/gm;

/** Without the functions, structs and defines that nothing uses; the functions in `kept` are for others to call. */
function needed(source, kept) {
    const used = (text, name) => text.match(new RegExp(`\\b${name}\\b`, "g")).length > 1;
    for (let before = ""; before !== source; ) {
        before = source;
        for (const pattern of [FUNCTION, STRUCT, DEFINE])
            source = source.replace(pattern, (all, name) => (kept.includes(name) || used(source, name) ? all : ""));
    }
    return source;
}

/** With the value of each define that is no longer than a line for it in its place. */
function inlined(source) {
    for (let found; (found = /^#define (\w+) +(\S{1,10}|\(.*\)) *\n/m.exec(source)); ) {
        const [line, name, value] = found;
        source = source.replace(line, "").replace(new RegExp(`\\b${name}\\b`, "g"), value);
    }
    return source
        .replace(/\(\((\d) \+ 1\) \* \(\1 \+ 1\)\)/g, (_, degree) => (Number(degree) + 1) ** 2)
        .replace(/\((\d+) - 1\)/g, (_, number) => Number(number) - 1);
}

/** With the prefix gsgi_ before each name of ours that is visible in a shader. */
function prefixed(source) {
    const names = [FUNCTION, STRUCT, DEFINE].flatMap((pattern) => [...source.matchAll(pattern)].map((found) => found[1]));
    const own = [...names, ...COUNTS].filter((name) => !name.startsWith("gsgi_"));
    return source.replace(new RegExp(`\\b(${own.join("|")})\\b`, "g"), "gsgi_$1");
}

/** With the uniforms in the place of the parameters that pass them on; fetch_int(), which reads two, keeps its own. */
function bound(source) {
    const uniforms = /^uniform .*\n/gm, declared = source.match(uniforms).join("");
    const body = source.replace(uniforms, "")
        .replace(/highp u?sampler2D (?:gaussians|cells|lists),\s*|highp sampler2D data, /g, "") // parameters
        .replace(/\b(?:gsgi_)?gaussians, (?:(?:gsgi_)?cells, (?:gsgi_)?lists, )?/g, "") // arguments
        .replace("texelFetch(data, ", "texelFetch(gaussians, "); // the first, of fetch_data()
    return declared + body.replace(new RegExp(`\\b(${TEXTURES.join("|")})\\b`, "g"), "gsgi_$1");
}

/** The n-th name of one letter, or of two. */
function letters(n) {
    const last = String.fromCharCode(97 + n % 26);
    return n < 26 ? last : letters(Math.floor(n / 26) - 1) + last;
}

/** The new name of each of `names`, the most frequent in `text` first, the shortest that are not in `taken`. */
function shortNames(names, text, taken = []) {
    const count = (name) => text.match(new RegExp(`\\b${name}\\b`, "g")).length;
    const free = Array.from({ length: 99 }, (_, n) => letters(n)).filter((name) => !taken.includes(name));
    return new Map([...new Set(names)].sort((a, b) => count(b) - count(a)).map((name, i) => [name, free[i]]));
}

/** The first groups of all that a pattern finds. */
function found(pattern, text) {
    return [...text.matchAll(pattern)].map((match) => match[1]);
}

/** With short names of variables, parameters and members of structs, and behind the prefix of functions and structs. */
function shortened(source) {
    const locals = source.replace(FUNCTION, (text) => {
        const type = /\b(?:float|int|uint|bool|[iu]?vec[234]|u?sampler2D|gsgi_Reader) (\w+)\b(?! *\()/g;
        const short = shortNames([...found(type, text), ...found(/, (\w+) = /g, text)], text);
        return text.replace(/(?<![.\w])\w+\b/g, (name) => short.get(name) ?? name);
    });
    const struct = source.match(STRUCT).join(""), kept = found(/ (\w)(?=;|\[)/g, struct);
    const members = shortNames(found(/ (\w{3,})(?=;|\[)/g, struct), source, [...kept, ..."xyzwrgbastpq"]); // no swizzles
    const flat = locals
        .replace(STRUCT, (text) => text.replace(/(?<= )\w+(?=;|\[)/g, (name) => members.get(name) ?? name))
        .replace(/(?<=\.)\w{3,}\b/g, (name) => members.get(name) ?? name);
    const seen = [...COUNTS, ...TEXTURES, "indirect", "indirect_free"].map((name) => `gsgi_${name}`); // what hosts name
    const ours = shortNames(found(/(gsgi_\w+)/g, flat).filter((name) => !seen.includes(name)), flat);
    COUNTS.forEach((name, i) => ours.set(`gsgi_${name}`, i)); // lookupSource() puts the counts in the place of numbers
    return flat.replace(/gsgi_\w+/g, (name) => ours.has(name) ? `gsgi_${ours.get(name)}` : name);
}

/** With numbers in the fewest digits that are the same float32. */
function rounded(source) {
    return source.replace(/(?<![\w.])\d+\.\d+(?![\w.])/g, (text) => {
        for (let digits = 1; ; ++digits) {
            const short = Number(Number(text).toPrecision(digits));
            if (Math.fround(short) !== Math.fround(text)) continue;
            return Number.isInteger(short) ? `${short}.` : String(short).replace(/^0\./, ".");
        }
    }).replace(/\bvec[234]\([\w., ]+\)/g, (vector) => vector.replace(/(?<![\w.])(\d)\.(?![\w.])/g, "$1"));
}

function shaders() {
    const whole = bare(expanded("surface/gsgi_indirect.glsl"));
    const ours = prefixed(needed(bound(resolved(whole)), ["gsgi_indirect", "gsgi_indirect_free"]));
    // A $, which no name has, stands for the prefix.
    const lookup = merged(packed(shortened(inlined(rounded(ours))))).replaceAll("gsgi_", "$");
    const value = (name) => new RegExp(`#define ${name} +(\\S+)`).exec(whole)[1];
    const numbers = CONSTANTS.map((name) => `export const ${name} = ${value(name)};\n`).join("");
    return `${NOTE}${numbers}export const LOOKUP = \`${lookup}\n\`;\n`;
}

function pageShaders() {
    const part = (name, ...functions) => prefixed(needed(bare(expanded(name)), functions));
    const parts = {
        LIGHT: part("frame/light.glsl", "range_attenuation", "cone_attenuation"),
        SHADOW: part("frame/shadow.glsl", "shadow_lift"),
        ENVIRONMENT: part("frame/environment.glsl", "environment_texel"),
    };
    return NOTE + Object.entries(parts).map(([name, text]) => `export const ${name} = \`${text}\`;\n`).join("");
}

const written = { "shaders.js": shaders(), "page/shaders.js": pageShaders() };
const three = new URL("node_modules/three/", import.meta.url);
if (existsSync(three)) {
    const { build } = await import("esbuild");
    const entry = new URL("page/vendor.js", import.meta.url).pathname;
    const bundle = await build({ entryPoints: [entry], bundle: true, minify: true, format: "esm", write: false });
    written["page/three.js"] = bundle.outputFiles[0].text;
    written["page/three.LICENSE"] = readFileSync(new URL("LICENSE", three), "utf8");
}
for (const [name, text] of Object.entries(written)) {
    const path = new URL(name, import.meta.url);
    if (!process.argv.includes("--check")) writeFileSync(path, text);
    else if (readFileSync(path, "utf8") !== text) throw new Error(`${name} is not what build.mjs makes: run it`);
}
