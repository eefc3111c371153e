"""Changes to pictures and films: the chunks of PNG and AVI files.

In: a sound file. Out: one with other headers, sizes, checksums and contents; sound in its build, or not.
"""

from __future__ import annotations

import random
import struct
import zlib

PNG_HEAD = b"\x89PNG\r\n\x1a\n"
SIZES = (0, 1, 2, 7, 255, 4096, 8191, 8192, 8193, 65_535, 65_536, 10**6, 2**31 - 1, 2**31, 2**32 - 1)
Chunk = tuple[bytes, bytes]  # kind and content


def changed_png(rng: random.Random, raw: bytes) -> bytes:
    """A PNG with one to three changes."""
    chunks = _png_chunks(raw)
    wrong_sums = False
    for _ in range(rng.choice((1, 1, 2, 3))):
        kind, at = rng.randrange(9), rng.randrange(len(chunks))
        name, content = chunks[at]
        if kind in (0, 1):
            head = (
                list(struct.unpack(">IIBBBBB", chunks[0][1]))
                if chunks[0][0] == b"IHDR" and len(chunks[0][1]) == 13
                else None
            )
            if head is None:
                continue
            k = rng.randrange(7)
            head[k] = (
                rng.choice(SIZES)
                if k < 2
                else rng.randrange(256)
                if rng.random() < 0.3
                else rng.choice((0, 1, 2, 3, 4, 6, 8, 16))
            )
            chunks[0] = (b"IHDR", struct.pack(">IIBBBBB", *head))
        elif kind == 2:
            rows = zlib.compress(bytes([rng.randrange(256)]) * round(10 ** rng.uniform(0, 7)), 9)
            chunks = [(n, rows if n == b"IDAT" else c) for n, c in chunks]
        elif kind == 3:
            del chunks[at]
            if not chunks:
                return PNG_HEAD
        elif kind == 4:
            chunks[at:at] = [(name, content)] * rng.choice((1, 2, 1000))
        elif kind == 5:
            chunks.insert(
                at,
                (
                    rng.choice(
                        (
                            b"tEXt",
                            b"zTXt",
                            b"iTXt",
                            b"PLTE",
                            b"tRNS",
                            b"gAMA",
                            b"iCCP",
                            b"eXIf",
                            b"acTL",
                            b"fdAT",
                            b"JUNK",
                        )
                    ),
                    _content(rng),
                ),
            )
        elif kind == 6:
            chunks[at] = (name, _bitten(rng, content))
        elif kind == 7:
            wrong_sums = True
        else:
            rng.shuffle(chunks)
    out = PNG_HEAD
    for name, content in chunks:
        total = rng.randrange(2**32) if wrong_sums and rng.random() < 0.5 else zlib.crc32(name + content)
        size = rng.choice(SIZES) if rng.random() < 0.01 else len(content)
        out += struct.pack(">I", size) + name + content + struct.pack(">I", total)
    return out[: rng.randrange(len(out) + 1)] if rng.random() < 0.05 else out


def _png_chunks(raw: bytes) -> list[Chunk]:
    found, at = [], len(PNG_HEAD)
    while at + 12 <= len(raw):
        size = struct.unpack(">I", raw[at : at + 4])[0]
        found.append((raw[at + 4 : at + 8], raw[at + 8 : at + 8 + size]))
        at += 12 + size
    return found


def _content(rng: random.Random) -> bytes:
    kind = rng.randrange(3)
    if kind == 0:
        return b"key\0\0" + zlib.compress(b"x" * round(10 ** rng.uniform(0, 7)), 9)
    return (
        bytes([rng.randrange(256)]) * round(10 ** rng.uniform(0, 5)) if kind == 1 else rng.randbytes(rng.randrange(200))
    )


def _bitten(rng: random.Random, content: bytes) -> bytes:
    """Some bytes changed, gone or new."""
    found = bytearray(content)
    for _ in range(rng.choice((1, 1, 3, 30))):
        at = rng.randrange(len(found) + 1)
        found[at : at + rng.randrange(3)] = rng.randbytes(rng.randrange(3))
    return bytes(found)


def changed_avi(rng: random.Random, raw: bytes) -> bytes:
    """An AVI with one to three changes: of numbers in its headers, of whole chunks, or of bytes in pictures."""
    chunks = _avi_chunks(raw, 12, len(raw))
    out = bytearray(raw)
    for _ in range(rng.choice((1, 1, 2, 3))):
        kind = rng.randrange(6)
        _, start, size = rng.choice(chunks)
        if kind in (0, 1, 2):  # numbers of the headers: rates, counts, sizes
            heads = [(s, n) for name, s, n in chunks if name in (b"avih", b"strh", b"strf", b"idx1") and n >= 8]
            at, length = rng.choice(heads)
            at += 4 * rng.randrange(min(length // 4, 20))
            value = rng.choice((*SIZES, 30, 90_000, rng.randrange(2**32)))
            out[at : at + 4] = struct.pack("<I", value)
        elif kind == 3:
            out[start : start + 1 + rng.randrange(4)] = rng.randbytes(4)
        elif kind == 4:  # a chunk that says to be of another size
            out[start - 4 : start] = struct.pack("<I", rng.choice((*SIZES, size + 1, max(size - 1, 0))))
        else:
            part = raw[start - 8 : start + size + size % 2]
            end = min(start + size, len(out))
            out[end:end] = part * min(rng.choice((1, 2, 1000, 100_000)), (1 << 22) // max(len(part), 1) + 1)
            break
    found = bytes(out)
    return found[: rng.randrange(len(found) + 1)] if rng.random() < 0.1 else found


def _avi_chunks(raw: bytes, at: int, end: int) -> list[tuple[bytes, int, int]]:
    """Kind, beginning of the content, and size of all chunks, those in lists too."""
    found = []
    while at + 8 <= end:
        name, size = raw[at : at + 4], struct.unpack("<I", raw[at + 4 : at + 8])[0]
        found.append((name, at + 8, size))
        if name == b"LIST":
            found += _avi_chunks(raw, at + 12, min(at + 8 + size, end))
        at += 8 + size + size % 2
    return found
