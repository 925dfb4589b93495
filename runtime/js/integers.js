/** Streams of integers as bits; runtime/file/FORMAT.md is the specification. */
import { DELTA, EXPONENTIAL, FOLDED_BITS, MAGNITUDE_MAX, SHIFT_BITS, SHIFT_MAX, expect } from "./format.js";

/** What reads the streams in the bytes from `begin` to `end`, one after the other. */
export function openStreams(bytes, begin, end) {
    const size = end - begin, words = new Uint32Array(size / 4 + 2);
    new Uint8Array(words.buffer).set(bytes.subarray(begin, end));
    let at = 0, start = begin; // of what is next, from `begin` on; of the stream that is read, from that of the file

    /** What follows is at the next whole byte from `bit` on; there must be zeros up to it. */
    function skipTo(bit) {
        at = (bit + 7) / 8 | 0;
        expect(at <= size && !(bits(words, bit) & (1 << (-bit & 7)) - 1), start);
    }

    /** LEB128: seven bits a byte, lowest first; the top bit says that more follow. */
    function varint() {
        for (let number = 0, shift = 0; ; shift += 7) {
            expect(shift < 28, start);
            const byte = bits(words, 8 * at++);
            number |= (byte & 0x7f) << shift;
            if (!(byte & 0x80)) return number;
        }
    }

    /** The integers of the next stream, an Int32Array of `count`, checked to be from `low` to `high`. */
    function read(count, low = -MAGNITUDE_MAX, high = MAGNITUDE_MAX) {
        start = begin + at;
        const flags = bits(words, 8 * at++) & 0xff, shift = flags & SHIFT_BITS, exponential = flags & EXPONENTIAL;
        let before = unfolded(varint());
        const unaryBytes = varint(), lows = at + unaryBytes;
        expect(shift <= SHIFT_MAX && flags < 0x80 && lows <= size && count <= 8 * unaryBytes, start);
        const values = new Int32Array(count), most = exponential ? FOLDED_BITS - shift : 1 << FOLDED_BITS - shift;
        let unary = 8 * at, bit = 8 * lows;
        for (let i = 0; i < count; ++i) {
            let prefix = 0, word;
            for (; !(word = bits(words, unary)); unary += 32) expect((prefix += 32) <= most, start);
            const zeros = 31 - Math.clz32(word & -word);
            unary += zeros + 1;
            expect((prefix += zeros) <= most, start);
            const width = exponential ? prefix + shift : shift, first = exponential ? (1 << prefix) - 1 : prefix;
            const value = before + unfolded((first << shift) + (bits(words, bit) & (1 << width) - 1));
            bit += width;
            expect(low <= value && value <= high, start);
            values[i] = value;
            if (flags & DELTA) before = value;
        }
        skipTo(unary);
        expect(at === lows, start);
        skipTo(bit);
        return values;
    }

    return {
        begin, read,

        /** Replaces the `widths` of the next integers, an Int32Array of at most 31 bits each, by the integers. */
        readBits(widths) {
            let bit = 8 * at;
            for (let i = 0; i < widths.length; ++i) {
                const width = widths[i];
                widths[i] = bits(words, bit) & (1 << width) - 1;
                bit += width;
            }
            skipTo(bit);
            return widths;
        },

        /** Codes (n, 3) of colours, from -most to most: red and blue are stored less green, or not at all if `grey`. */
        colours(n, most, grey) {
            const green = read(n), others = grey || read(2 * n);
            return new Int32Array(3 * n).map((_, i) => {
                const from = i / 3 | 0, channel = i % 3;
                const code = green[from] + (grey || channel === 1 ? 0 : others[2 * from + (channel >> 1)]);
                expect(Math.abs(code) <= most, start);
                return code;
            });
        },

        /** All has been read. */
        finish() {
            expect(at === size, begin + at);
        },
    };
}

/** The 32 bits from `bit` on; zeros follow the last. */
function bits(words, bit) {
    return words[bit / 32 | 0] >>> bit | words[bit / 32 + 1 | 0] << 1 << ~bit;
}

function unfolded(folded) {
    return folded >>> 1 ^ -(folded & 1);
}
