/**
 * SHA-256 of bytes that come one after the other (FIPS 180-4). The browser's own digest takes a whole message at once, which for a
 * file of several gigabytes is more than a page may hold.
 */
export class Sha256 {
  private readonly state = Uint32Array.from(H);
  private readonly words = new Uint32Array(64);
  /** What does not fill a block yet. */
  private readonly rest = new Uint8Array(BLOCK);
  private kept = 0;
  private length = 0;

  update(bytes: Uint8Array): this {
    this.length += bytes.length;
    let at = 0;
    if (this.kept > 0) {
      at = Math.min(BLOCK - this.kept, bytes.length);
      this.rest.set(bytes.subarray(0, at), this.kept);
      this.kept += at;
      if (this.kept < BLOCK) return this;
      this.block(this.rest, 0);
    }
    for (; at + BLOCK <= bytes.length; at += BLOCK) this.block(bytes, at);
    this.rest.set(bytes.subarray(at));
    this.kept = bytes.length - at;
    return this;
  }

  /** The digest in hexadecimal; the end of it: nothing may come after. */
  hex(): string {
    const bits = this.length * 8;
    const padded = new Uint8Array(this.kept < BLOCK - 8 ? BLOCK : 2 * BLOCK);
    padded.set(this.rest.subarray(0, this.kept));
    padded[this.kept] = 0x80;
    const end = new DataView(padded.buffer, padded.length - 8);
    end.setUint32(0, Math.floor(bits / 2 ** 32));
    end.setUint32(4, bits >>> 0);
    for (let at = 0; at < padded.length; at += BLOCK) this.block(padded, at);
    return [...this.state].map((word) => word.toString(16).padStart(8, "0")).join("");
  }

  private block(bytes: Uint8Array, at: number): void {
    const w = this.words;
    for (let i = 0, k = at; i < 16; i++, k += 4) w[i] = (bytes[k]! << 24) | (bytes[k + 1]! << 16) | (bytes[k + 2]! << 8) | bytes[k + 3]!;
    for (let i = 16; i < 64; i++) {
      const [x, y] = [w[i - 15]!, w[i - 2]!];
      w[i] = w[i - 16]! + (turned(x, 7) ^ turned(x, 18) ^ (x >>> 3)) + w[i - 7]! + (turned(y, 17) ^ turned(y, 19) ^ (y >>> 10));
    }
    const s = this.state;
    let a = s[0]!, b = s[1]!, c = s[2]!, d = s[3]!, e = s[4]!, f = s[5]!, g = s[6]!, h = s[7]!;
    for (let i = 0; i < 64; i++) {
      const one = (h + (turned(e, 6) ^ turned(e, 11) ^ turned(e, 25)) + ((e & f) ^ (~e & g)) + K[i]! + w[i]!) | 0;
      const two = ((turned(a, 2) ^ turned(a, 13) ^ turned(a, 22)) + ((a & b) ^ (a & c) ^ (b & c))) | 0;
      h = g;
      g = f;
      f = e;
      e = (d + one) | 0;
      d = c;
      c = b;
      b = a;
      a = (one + two) | 0;
    }
    s[0]! += a;
    s[1]! += b;
    s[2]! += c;
    s[3]! += d;
    s[4]! += e;
    s[5]! += f;
    s[6]! += g;
    s[7]! += h;
  }
}

const BLOCK = 64;
const turned = (x: number, by: number): number => (x >>> by) | (x << (32 - by));

/** The first primes: the constants are fractions of their roots. */
const PRIMES = Array.from({ length: 312 }, (_, n) => n).filter((n) => n > 1 && Array.from({ length: n }, (_, d) => d).every((d) => d < 2 || n % d !== 0));
/** The first 32 bits of the fraction of a root, exactly: floor(root · 2^32) mod 2^32 by whole numbers. */
function fraction(prime: number, degree: 2 | 3): number {
  const wanted = BigInt(prime) << BigInt(32 * degree);
  let root = BigInt(Math.floor(prime ** (1 / degree) * 2 ** 32));
  const power = (x: bigint) => x ** BigInt(degree);
  while (power(root) > wanted) root--;
  while (power(root + 1n) <= wanted) root++;
  return Number(root & 0xffffffffn);
}
const H = Uint32Array.from(PRIMES.slice(0, 8), (prime) => fraction(prime, 2));
const K = Uint32Array.from(PRIMES.slice(0, 64), (prime) => fraction(prime, 3));
