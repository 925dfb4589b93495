// Lifts the shaders of glsl/ into shaders.js:   node build.mjs [--check]
// With --check nothing is written, and the exit code says whether the file is what it would be.
import { readFileSync, writeFileSync } from "node:fs";

const GLSL = new URL("../../glsl/", import.meta.url);
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

/** Without indentation and columns. */
function packed(source) {
    return source.replace(/^ +/gm, "").replace(/ +/g, " ").trim();
}

/** With `#if SH_DEGREE > N` resolved. */
function resolved(source) {
    const degree = Number(/#define SH_DEGREE (\d)/.exec(source)[1]);
    return source.replace(/#if SH_DEGREE > (\d)\n([^]*?)#endif\n/g, (_, least, body) => (degree > least ? body : ""));
}

const DEFINE = /^#define (\w+).*\n/gm;
const FUNCTION = /^\w+ (\w+)\([^)]*\) \{\n[^]*?^\}\n/gm;
const STRUCT = /^struct (\w+) \{\n[^]*?^\};\n/gm;

/** Without the functions, structs and defines that nothing uses. */
function needed(source) {
    const used = (text, name) => text.match(new RegExp(`\\b${name}\\b`, "g")).length > 1;
    for (let before = ""; before !== source; ) {
        before = source;
        for (const pattern of [FUNCTION, STRUCT, DEFINE])
            source = source.replace(pattern, (all, name) => (name === "gsgi_indirect" || used(source, name) ? all : ""));
    }
    return source;
}

/** With the prefix gsgi_ before each name of ours that is visible in a shader. */
function prefixed(source) {
    const names = [FUNCTION, STRUCT, DEFINE].flatMap((pattern) => [...source.matchAll(pattern)].map((found) => found[1]));
    const own = [...names, "FINE_SH_COUNT", "COARSE_SH_COUNT"].filter((name) => !name.startsWith("gsgi_"));
    return source.replace(new RegExp(`\\b(${own.join("|")})\\b`, "g"), "gsgi_$1");
}

const whole = bare(expanded("surface/gsgi_indirect.glsl"));
const lookup = packed(prefixed(needed(resolved(whole))));
const numbers = CONSTANTS.map((name) => `export const ${name} = ${new RegExp(`#define ${name} +(\\S+)`).exec(whole)[1]};\n`);
const output = new URL("shaders.js", import.meta.url);
const module = `// Written by build.mjs from glsl/. Do not edit.\n${numbers.join("")}export const LOOKUP = \`${lookup}\n\`;\n`;
if (!process.argv.includes("--check")) writeFileSync(output, module);
else if (readFileSync(output, "utf8") !== module) throw new Error("shaders.js is not what build.mjs makes of glsl/");
