/** gsgi: baked indirect light of .gsgi files in a browser. */

export { FormatError, decode } from "./decode.js";
export { lookupSource, recolour, shCounts } from "./lookup.js";
export { lookupTables } from "./tables.js";
export { groupNames, weighted } from "./weights.js";
