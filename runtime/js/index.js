/** gsgi: baked indirect light of .gsgi files in a browser. */

export { FormatError, decode } from "./decode.js";
export { lookupSource, lookupTables, shCounts } from "./lookup.js";
