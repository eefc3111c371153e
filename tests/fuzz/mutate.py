"""What becomes of a sound file, or of a command line, in one trial: by its kind and a number.

In: a name that says what the file holds, its sound content, and a generator of random numbers. Out: changed content.
"""

from __future__ import annotations

import json
import random
import re
import tomllib
from collections.abc import Callable, Sequence
from functools import cache
from typing import Any

from tests.fuzz import chunks, tables, trees
from tests.fuzz.verbs import SEEDS, Command, Verb

PLACES = ("clips", "model.toml", "track.csv", "pictures", "film.avi", ".", "/", "/dev/null", "/dev/zero", "-", "--")
TOKEN = re.compile(rb"[0-9]+|[A-Z]+|.", re.DOTALL)


def changed_file(rng: random.Random, name: str) -> bytes:
    """The content of a seed, changed as its kind can be."""
    suffix = name.rpartition(".")[2]
    return KINDS[suffix](rng, (SEEDS / name).read_bytes())


def changed_command(rng: random.Random, verbs: Sequence[Verb]) -> Command:
    """A command whose files, or words, are changed: one of ten its words alone."""
    verb = rng.choices(verbs, [one.share for one in verbs])[0]
    words = list(verb.words)
    if not verb.reads or rng.random() < 0.1:
        _change_words(rng, words)
        return Command(verb, tuple(words), {})
    names = sorted(set(rng.choices(verb.reads, k=rng.choice((1, 1, 1, 2)))))
    return Command(verb, tuple(words), {name: changed_file(rng, name) for name in names})


def _change_words(rng: random.Random, words: list[str]) -> None:
    at, kind = rng.randrange(min(2, len(words) - 1), len(words)), rng.randrange(6)
    if kind == 0:
        del words[at]
    elif kind == 1:
        words.insert(at, words[rng.randrange(1, len(words))])
    elif kind == 2:
        words[at] = rng.choice(PLACES)
    else:
        try:
            new: Any = trees.number(rng, float(words[at]))
        except ValueError:
            new = trees.word(rng) if rng.random() < 0.6 else words[at][: rng.randrange(len(words[at]) + 1)]
        words[at] = f"{new:x}"[:3000] if isinstance(new, int) and abs(new) > 10**300 else str(new)
    words[:] = [word.replace("\0", "").encode("utf-8", "replace").decode() for word in words]


@cache
def _trees(suffix: str) -> list[Any]:
    """What all seeds of a kind hold."""
    loads: Callable[[str], Any] = tomllib.loads if suffix == "toml" else json.loads
    return [loads(path.read_text()) for path in sorted(SEEDS.rglob(f"*.{suffix}"))]


def _toml(rng: random.Random, raw: bytes) -> bytes:
    tree = trees.changed(rng, tomllib.loads(raw.decode()), _trees("toml"))
    try:
        return trees.text_of(rng, tree, True)
    except (TypeError, ValueError, RecursionError):  # no TOML can hold it
        return raw


def _json(rng: random.Random, raw: bytes) -> bytes:
    tree = trees.changed(rng, json.loads(raw), _trees("json"))
    try:
        return trees.text_of(rng, tree, False)
    except (TypeError, ValueError, RecursionError):
        return raw


def _json_lines(rng: random.Random, raw: bytes) -> bytes:
    lines = raw.splitlines()
    for _ in range(rng.choice((1, 1, 3))):
        k = rng.randrange(len(lines))
        kind = rng.randrange(6)
        if kind == 0:
            lines[k] = rng.choice(lines)
        elif kind == 1:
            lines[k:k] = [lines[k]] * rng.choice((1, 1000))
        elif kind == 2:
            lines[k] = lines[k][: rng.randrange(len(lines[k]) + 1)]
        else:
            try:
                lines[k] = _json(rng, lines[k]).replace(b"\n", b" ")
            except (ValueError, RecursionError):  # a line that was spoilt before
                lines[k] = b""
    return b"\n".join(lines) + rng.choice((b"\n", b"\n", b"\n", b""))


def _csv(rng: random.Random, raw: bytes) -> bytes:
    return tables.csv_of(rng, tables.changed(rng, tables.table_of(raw)))


def _parquet(rng: random.Random, raw: bytes) -> bytes:
    """Of the same cells as the CSV: its seed is that table as a Parquet file."""
    return tables.parquet_of(rng, tables.changed(rng, tables.table_of((SEEDS / "track.csv").read_bytes())))


def _text(rng: random.Random, raw: bytes) -> bytes:
    """Words, numbers and signs of a text that are gone, doubled, exchanged or others."""
    tokens = TOKEN.findall(raw) or [b""]
    for _ in range(rng.choice((1, 1, 2, 5))):
        k, kind = rng.randrange(len(tokens)), rng.randrange(6)
        if kind == 0:
            del tokens[k]
            tokens = tokens or [b""]
        elif kind == 1:
            tokens[k:k] = [tokens[k]] * rng.choice((1, 2, 100, 10_000))
        elif kind == 2:
            tokens[k] = rng.choice(tokens)
        elif kind == 3:
            tokens[k] = rng.choice(
                (b"0", b"-1", b"9" * 400, b"1e9", b"nan", b"\n", b"\r\n", b"\xff", b"\x00", b":", b"=", b"*", b"!")
            )
        elif kind == 4:
            tokens[k] = trees.word(rng).encode("utf-8", "surrogatepass")[:1000]
        else:
            tokens[k] = rng.randbytes(rng.randrange(4))
    return b"".join(tokens)


KINDS: dict[str, Callable[[random.Random, bytes], bytes]] = {
    "toml": _toml, "json": _json, "jsonl": _json_lines, "csv": _csv, "parquet": _parquet, "txt": _text,
    "png": chunks.changed_png, "avi": chunks.changed_avi,
}  # fmt: skip
