/** A worker that decodes the bytes of a .gsgi file and builds its tables, which takes up to a second. */

import { prepare } from "./prepare.js";

onmessage = ({ data }) => postMessage(prepare(data));
