/** A worker that decodes the bytes of a .gsgi file and builds its tables, which takes up to a second. */

import { decode } from "./decode.js";
import { lookupTables } from "./lookup.js";

onmessage = ({ data }) => {
    const bake = decode(data), tables = lookupTables(bake);
    postMessage({ bake, tables }, [tables.gaussians.buffer, tables.cells.buffer, tables.lists.buffer]);
};
