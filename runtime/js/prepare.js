/** What a light is made of, from the bytes of its file. Apart, since most pages need it in their worker alone. */

import { decode } from "./decode.js";
import { lookupTables } from "./tables.js";

export function prepare(data) {
    const bake = decode(data);
    return { bake, tables: lookupTables(bake) };
}
