"""Damage to files and options: what slips, accidents and hostile hands do to them.

In: a verb, or a reader, and its seeds. Out: a `Damaged` command, or file, drawn by hypothesis.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hypothesis import strategies as st

from tests.fuzz.readers import FileReader
from tests.fuzz.verbs import SEEDS, VERBS, Verb

NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?")
QUOTED = re.compile(rb'"[^"\n]*"')
MAX_DAMAGES = 3
KINDS = ["number"] * 6 + ["text"] * 2 + ["line", "gone", "double", "swap", "bytes", "cut", "noise"]  # of damage
NUMBERS = [
    b"nan", b"inf", b"-inf", b"NaN", b"Infinity", b"1e999", b"0", b"-0.0", b"-1", b"1", b"3.5", b"1e-300", b"5e-324",
    b"1e308", b"-1e308", b"1e300", b"-1e300", b"1e18", b"1e9", b"1e6", b"1000", b"0.001", b"1e-9", b"9" * 400,
    b"1" * 5000, b"0x10", b"1_0", b"true", b"null", b"", b"--1", b"1,5", b"2024-02-31", b'"1"', b"[1]", b"{}",
]  # fmt: skip
TEXTS = [
    b'""', b'"x"', b'" "', b'"\\ud800"', b'"\\u0000"', b'"a\\nb"', b'"\\u001b[2J"',
    b'"../../etc/passwd"', b'"/dev/zero"',
    b'"' + b"y" * 5000 + b'"', b'"cue"', b'"white"', b"3", b"true", b"null", b"[]", b"{}", b"{ a = 1 }", b'"\xff"',
    '"é\u2028"'.encode(), b'"nan"', b'"1e308"', b'["a"]', b'"+x"',
]  # fmt: skip
LINES = [
    b"[" * 3000, b"x = " + b"[" * 3000, b"[[[[", b"x = 3", b"[table]", b"[fit]", b"fit = 3", b"fit = 3.5",
    b"effect = 3",
    b"[[effect]]", b"[[clip]]", b"\x00", b"\xff\xfe", b"\r", b'"""', b",,,,,,", b"a" * 5000, b"," * 5000, b'{"a": 1}',
    b"lenght = 3", b"[execution]", b"[size]", b"extra = { a = [1, { b = 2 }] }", b'"format": "x",',
]  # fmt: skip
WORDS = [
    "", " ", "-1", "0", "1e308", "nan", "9" * 400, "a\nb", "y" * 5000, "/dev/null", "/dev/zero", ".", "/", "none",
    "clips", "clips/clips.toml", "model.toml", "launcher.toml", "pictures", "\udcff", "é\u2028", "-", "--",
    "--help", "1,2",
]  # fmt: skip


@dataclass(frozen=True)
class Damaged:
    """A command line, and the files that differ from the seeds."""

    verb: Verb
    words: tuple[str, ...]
    files: Mapping[str, bytes]


@st.composite
def commands(draw: st.DrawFn, only: str = "") -> Damaged:
    """Commands with one to three damages, most of them to files; those that begin with `only`."""
    verbs = [verb for verb in VERBS for _ in range(verb.share) if verb.line.startswith(only)]
    verb = draw(st.sampled_from(verbs))
    words, files = list(verb.words), dict[str, bytes]()
    for _ in range(draw(st.integers(1, MAX_DAMAGES))):
        if not verb.reads or draw(st.integers(0, 9)) == 0:
            at = draw(st.integers(2, len(words) - 1)) if len(words) > 2 else 1
            words[at] = draw(st.sampled_from(WORDS) | st.text(max_size=6).map(lambda t: t.replace("\0", "")))
        else:
            name = draw(st.sampled_from(verb.reads))
            before = files.get(name, (SEEDS / name).read_bytes())
            files[name] = draw(_damaged(before))
    return Damaged(verb, tuple(words), files)


@st.composite
def damaged_files(draw: st.DrawFn, readers: Sequence[FileReader]) -> tuple[FileReader, str, bytes]:
    """A reader, which of its seeds is damaged, and that file with one to three damages."""
    reader = draw(st.sampled_from(readers))
    name = draw(st.sampled_from(reader.seeds))
    raw = (SEEDS / name).read_bytes()
    for _ in range(draw(st.integers(1, MAX_DAMAGES))):
        raw = draw(_damaged(raw))
    return reader, name, raw


@st.composite
def _damaged(draw: st.DrawFn, raw: bytes) -> bytes:
    kind = draw(st.sampled_from(KINDS))
    if kind in ("number", "text"):
        found = list((NUMBER if kind == "number" else QUOTED).finditer(raw))
        if not found:
            return raw
        one = found[draw(st.integers(0, len(found) - 1))]
        wild = st.floats().map(lambda v: repr(v).encode()) | st.integers().map(lambda v: str(v).encode())
        new = draw(st.sampled_from(NUMBERS) | wild if kind == "number" else st.sampled_from(TEXTS))
        return raw[: one.start()] + new + raw[one.end() :]
    if kind == "noise":
        return draw(st.binary(max_size=200))
    if kind in ("bytes", "cut"):
        at = draw(st.integers(0, len(raw)))
        return raw[:at] + (
            draw(st.binary(max_size=4)) + raw[at + draw(st.integers(0, 4)) :] if kind == "bytes" else b""
        )
    lines = raw.split(b"\n")
    at, other = (draw(st.integers(0, len(lines) - 1)) for _ in range(2))
    if kind == "gone":
        del lines[at]
    elif kind == "swap":
        lines[at], lines[other] = lines[other], lines[at]
    else:
        lines.insert(at, lines[other] if kind == "double" else draw(st.sampled_from(LINES)))
    return b"\n".join(lines)
