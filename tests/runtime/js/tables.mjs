// Writes the look-up's textures and GLSL for each file named, as FILE.gaussians, FILE.cells, FILE.lists, FILE.glsl.
import { readFileSync, writeFileSync } from "node:fs";
import { pathToFileURL } from "node:url";

const { decode, lookupSource, lookupTables, shCounts } = await import(pathToFileURL(`${process.env.JS}/index.js`));
for (const path of process.argv.slice(2)) {
    const bake = decode(readFileSync(path)), tables = lookupTables(bake);
    for (const name of ["gaussians", "cells", "lists"]) writeFileSync(`${path}.${name}`, tables[name]);
    writeFileSync(`${path}.glsl`, lookupSource(shCounts(bake), "room0_"));
}
