/** Streams of integers as bits; runtime/file/FORMAT.md is the specification. */

const SHIFT_BITS = 0x1f, EXPONENTIAL = 0x20, DELTA = 0x40;
const SHIFT_MAX = 24, FOLDED_BITS = 28;
const MAGNITUDE_MAX = 2 ** 26;

/** Reads the streams of a section, bytes `at` to `end`; `expect(condition, byte)` throws if it is false. */
export class Integers {
    constructor(bytes, at, end, expect) {
        Object.assign(this, { bytes, at, end, expect });
    }

    /** The `count` integers of the next stream, an Int32Array. */
    read(count) {
        const start = this.at;
        this.expect(start < this.end, start);
        const flags = this.bytes[start], shift = flags & SHIFT_BITS, exponential = (flags & EXPONENTIAL) !== 0;
        this.expect(shift <= SHIFT_MAX && flags < 0x80, start);
        ++this.at;
        const base = this.#varint(), unaryBytes = this.#varint();
        this.expect(unaryBytes <= this.end - this.at, this.at);
        const values = this.#unary(count, unaryBytes);

        const most = exponential ? FOLDED_BITS - shift : 2 ** (FOLDED_BITS - shift);
        let longest = 0, total = shift * count;
        for (let i = 0; i < count; ++i) {
            longest = Math.max(longest, values[i]);
            if (exponential) total += values[i];
        }
        this.expect(longest <= most, start);
        const bits = this.#bits(total), delta = (flags & DELTA) !== 0;
        let fits = true, before = unfolded(base);
        for (let i = 0; i < count && fits; ++i) {
            const prefix = values[i], high = exponential ? (1 << prefix) - 1 : prefix;
            const value = before + unfolded((high << shift) + bits.take(exponential ? prefix + shift : shift));
            fits = value <= MAGNITUDE_MAX && value >= -MAGNITUDE_MAX;
            values[i] = value;
            if (delta) before = value;
        }
        this.expect(fits, start);
        return values;
    }

    /** Replaces the `widths` of the next integers, an Int32Array of at most 28 bits each, by the integers. */
    readBits(widths) {
        const bits = this.#bits(widths.reduce((sum, width) => sum + width, 0));
        for (let i = 0; i < widths.length; ++i) widths[i] = bits.take(widths[i]);
        return widths;
    }

    /** LEB128: seven bits a byte, lowest first; the top bit says that more follow. */
    #varint() {
        let number = 0;
        for (let shift = 0; ; shift += 7) {
            this.expect(this.at < this.end && shift < 28, this.at);
            const byte = this.bytes[this.at++];
            number |= (byte & 0x7f) << shift;
            if (byte < 0x80) return number;
        }
    }

    /** The lengths of `count` runs of zeros, each before a one, which take the next `size` bytes. */
    #unary(count, size) {
        const { bytes, at } = this, lengths = new Int32Array(size * 8 < count ? 0 : count);
        let found = 0, run = 0, ended = 0;
        for (let i = 0; i < size && found <= count; ++i) {
            let byte = bytes[at + i], left = 8;
            while (byte) {
                const skipped = 31 - Math.clz32(byte & -byte);
                lengths[found++] = run + skipped;
                run = 0;
                byte >>= skipped + 1;
                left -= skipped + 1;
                ended = i + 1;
            }
            run += left;
        }
        this.expect(found === count && ended === size, at);
        this.at += size;
        return lengths;
    }

    /** A reader of the next `total` bits, which end in zeros to a whole byte. */
    #bits(total) {
        const { bytes, at } = this, size = Math.ceil(total / 8), last = at + size - 1;
        this.expect(size <= this.end - at, at);
        this.expect(total % 8 === 0 || bytes[last] >> total % 8 === 0, last);
        this.at += size;
        return new Bits(bytes, at);
    }
}

/** Reads bits, lowest first. */
class Bits {
    constructor(bytes, at) {
        this.bytes = bytes;
        this.at = at;
        this.held = 0; // `left` bits
        this.left = 0;
    }

    /** The next `width` bits, at most 28. */
    take(width) {
        if (width > 16) {
            const low = this.take(16);
            return low + (this.take(width - 16) << 16);
        }
        while (this.left < width) {
            this.held |= this.bytes[this.at++] << this.left;
            this.left += 8;
        }
        const value = this.held & (1 << width) - 1;
        this.held >>= width;
        this.left -= width;
        return value;
    }
}

function unfolded(folded) {
    return folded >>> 1 ^ -(folded & 1);
}
