import { createHash } from "node:crypto";
import { describe, expect, it } from "vitest";
import { Sha256 } from "./sha256";

describe("SHA-256 in pieces", () => {
  it("gives the published digests (FIPS 180-4 examples, NIST CSRC)", () => {
    const of = (text: string) => new Sha256().update(new TextEncoder().encode(text)).hex();
    expect(of("abc")).toBe("ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    expect(of("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq")).toBe("248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
    expect(of("")).toBe("e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  });
  it("does not care where the pieces end", () => {
    const bytes = Uint8Array.from({ length: 1000 }, (_, i) => (i * i * 31) & 255);
    for (const size of [1, 55, 56, 63, 64, 65, 129, 1000]) {
      const sum = new Sha256();
      for (let at = 0; at < bytes.length; at += size) sum.update(bytes.subarray(at, at + size));
      expect(sum.hex()).toBe(createHash("sha256").update(bytes).digest("hex"));
    }
  });
});
