/** Streams of integers as bits; runtime/file/FORMAT.md is the specification. */
import { DELTA, EXPONENTIAL, FOLDED_BITS, MAGNITUDE_MAX, SHIFT_BITS, SHIFT_MAX, expect } from "./format.js";

/** What reads the streams in the bytes from `at` to `end`, one after the other. */
export function openStreams(bytes, at, end) {
    let start; // of the stream that is read

    /** The integers of the next stream, an Int32Array of `count`, checked to be from `low` to `high` if these are given. */
    function read(count, low, high) {
        expect(at < end, at);
        start = at;
        const flags = bytes[at++], shift = flags & SHIFT_BITS, exponential = flags & EXPONENTIAL;
        expect(shift <= SHIFT_MAX && flags < 0x80, start);
        const base = varint(), values = unary(count, varint());
        const most = exponential ? FOLDED_BITS - shift : 2 ** (FOLDED_BITS - shift);
        const take = openBits(shift * count + (exponential ? sum(values) : 0));
        let before = unfolded(base);
        for (let i = 0; i < count; ++i) {
            const prefix = values[i], first = exponential ? (1 << prefix) - 1 : prefix;
            expect(prefix <= most, start);
            const value = before + unfolded((first << shift) + take(exponential ? prefix + shift : shift));
            expect(Math.abs(value) <= MAGNITUDE_MAX, start);
            values[i] = value;
            if (flags & DELTA) before = value;
        }
        return low === undefined ? values : check(values, low, high);
    }

    /** The `values`; they must be from `low` to `high`, if there is one. */
    function check(values, low, high = Infinity) {
        for (let i = 0; i < values.length; ++i) expect(low <= values[i] && values[i] <= high, start);
        return values;
    }

    /** LEB128: seven bits a byte, lowest first; the top bit says that more follow. */
    function varint() {
        for (let number = 0, shift = 0; ; shift += 7) {
            expect(at < end && shift < 28, at);
            const byte = bytes[at++];
            number |= (byte & 0x7f) << shift;
            if (byte < 0x80) return number;
        }
    }

    /** The lengths of `count` runs of zeros, each before a one, which take the next `size` bytes. */
    function unary(count, size) {
        expect(size <= end - at, at);
        const lengths = new Int32Array(size * 8 < count ? 0 : count), bits = 8 * size;
        let found = 0, last = -1;
        for (let i = 0; i < bits; ++i)
            if (bytes[at + (i >> 3)] >> (i & 7) & 1) {
                lengths[found++] = i - last - 1;
                last = i;
            }
        expect(found === count && bits - last <= 8, at);
        at += size;
        return lengths;
    }

    /** A function that returns the next `width` bits, at most 28, of `total`, which end in zeros to a whole byte. */
    function openBits(total) {
        const from = bytes.subarray(at);
        let next = 0; // bit
        at += Math.ceil(total / 8);
        expect(at <= end && !(total % 8 && bytes[at - 1] >> total % 8), at);
        return function take(width) {
            if (width > 16) return take(16) | take(width - 16) << 16;
            const i = next >>> 3, held = from[i] | from[i + 1] << 8 | from[i + 2] << 16;
            return held >> ((next += width) - width & 7) & (1 << width) - 1;
        };
    }

    return {
        read, check,

        /** Replaces the `widths` of the next integers, an Int32Array of at most 28 bits each, by the integers. */
        readBits(widths) {
            return widths.map(openBits(sum(widths)));
        },

        /** Codes (n, 3) of colours, from -most to most: red and blue are stored less green, or not at all if `grey`. */
        readColours(n, most, grey) {
            const green = read(n), others = grey || read(2 * n);
            return check(new Int32Array(3 * n).map((_, i) => {
                const from = i / 3 | 0, channel = i % 3;
                return green[from] + (grey || channel === 1 ? 0 : others[2 * from + (channel >> 1)]);
            }), -most, most);
        },

        /** All has been read. */
        finish() {
            expect(at === end, at);
        },
    };
}

function sum(values) {
    return values.reduce((total, value) => total + value, 0);
}

function unfolded(folded) {
    return folded >>> 1 ^ -(folded & 1);
}
