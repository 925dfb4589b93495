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
    const code = (line) => line.replace(/ ?([-+*\/%=<>?:,;{}()|&]) ?/g, "$1");
    return lines.map((line) => (line.startsWith("#") ? `${line}\n` : code(line))).join("").replace(/(?<=[^\n])#/g, "\n#");
}

/** With `#if SH_DEGREE > N` resolved. */
function resolved(source) {
    const degree = Number(/#define SH_DEGREE (\d)/.exec(source)[1]);
    return source.replace(/#if SH_DEGREE > (\d)\n([^]*?)#endif\n/g, (_, least, body) => (degree > least ? body : ""));
}

const COUNTS = ["FINE_SH_COUNT", "COARSE_SH_COUNT", "RELIEF_COUNT"];
const SEEN = [...COUNTS, "indirect", "gaussians", "cells", "lists"]; // what hosts name, behind the prefix

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

/** With the value of each define that is no longer than its name in its place. */
function inlined(source) {
    for (let found; (found = /^#define (\w+) +(\S{1,8}|\(.*\)) *\n/m.exec(source)); ) {
        const [line, name, value] = found;
        source = source.replace(line, "").replace(new RegExp(`\\b${name}\\b`, "g"), value);
    }
    return source;
}

/** With the prefix gsgi_ before each name of ours that is visible in a shader. */
function prefixed(source) {
    const names = [FUNCTION, STRUCT, DEFINE].flatMap((pattern) => [...source.matchAll(pattern)].map((found) => found[1]));
    const own = [...names, ...COUNTS].filter((name) => !name.startsWith("gsgi_"));
    return source.replace(new RegExp(`\\b(${own.join("|")})\\b`, "g"), "gsgi_$1");
}

/** With short names of variables, parameters and members, which begin with _, and of what hosts do not name. */
function shortened(source) {
    const types = /(?:\b(?:float|int|uint|bool|vec[234]|u?sampler2D)|[$]Reader) (\w{3,})\b(?!\()/g, others = /,(\w{3,})=/g;
    const declared = [...source.matchAll(types), ...source.matchAll(others)];
    const swizzle = /^([xyzw]+|[rgba]+|[stpq]+)$/;
    const names = new Set(declared.map((found) => found[1]).filter((name) => !swizzle.test(name)));
    const short = new Map([...names].map((name, i) => [name, `_${i.toString(36)}`]));
    const own = new Set([...source.matchAll(/\$(\w+)/g)].map((found) => found[1]).filter((name) => !SEEN.includes(name)));
    const ours = new Map([...own].map((name, i) => [name, `f${i.toString(36)}`])); // no __, which GLSL reserves
    return source.replace(/\$(\w+)/g, (all, name) => `$${ours.get(name) ?? name}`)
        .replace(/(?<!\$)\b\w+\b/g, (name) => short.get(name) ?? name);
}

function shaders() {
    const whole = bare(expanded("surface/gsgi_indirect.glsl"));
    // A $, which no name has, stands for the prefix.
    const named = packed(inlined(prefixed(needed(resolved(whole), ["gsgi_indirect"])))).replaceAll("gsgi_", "$");
    const lookup = shortened(named);
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
