"""Changes to trees of tables, lists and values: what TOML and JSON files hold.

In: a tree, and others to take parts from. Out: a changed tree; `text_of` writes it with what no writer would: nesting
without end, and keys that are there twice.
"""

from __future__ import annotations

import copy
import datetime
import json
import math
import random
import re
from collections.abc import Callable, Sequence
from typing import Any

import tomli_w

NUMBERS: tuple[Any, ...] = (
    math.nan, math.inf, -math.inf, 0, 0.0, -0.0, -1, 1, 2, 0.5, 5e-324, 1e-300, 1e-9, 1e9, 1e18, 1e300, 1.7e308, -1e308,
    2**31, 2**63, -(2**63), 2**64, 10**400, -(10**4000),
)  # fmt: skip
WORDS = (
    "", " ", "x", "cue", "white", "red", "any", "none", "true", "nan", "-inf", "1e308", "3", "1,5", "a b", "a\nb",
    "a\rb", "\0", "\x1b[2J", "\u2028", "\u202e", "\ufeff", "e\u0301", "\U0001f3b1", "\ud800", "../../etc/passwd",
    "/dev/zero", "/dev/null", "clips/../clips/0001.csv", "%s%n", "{0}", "<script>alert(1)</script>", "__class__",
    "world", "a/b", "a.b.c", "[x]", "'", '"', "\\", "#", "=", "١٢",
)  # fmt: skip
OTHER_KINDS: tuple[Any, ...] = (
    True, False, None, [], {}, [[]], [None], {"a": 1}, ["a"], [1], [1, "a"], datetime.date(2024, 2, 29),
    datetime.datetime(1, 1, 1), datetime.time(23, 59),
)  # fmt: skip
NEST = re.compile(r'"@nest([\[{])(\d+)@"')
MAX_REPEATED_BYTES = 1 << 23  # of a part that is repeated, in all

Node = tuple[Any, Any]  # what holds a part, and its key or index there


def parts(tree: Any) -> list[Node]:
    """All parts of a tree."""
    found: list[Node] = []
    level = [tree]
    while level:
        inner = []
        for one in level:
            keys: Sequence[Any] = list(one) if isinstance(one, dict) else range(len(one))
            found += [(one, key) for key in keys]
            inner += [one[key] for key in keys if isinstance(one[key], dict | list)]
        level = inner
    return found


def word(rng: random.Random) -> str:
    """A text: one that is known to be odd, or one of any letters, or a long one."""
    kind = rng.random()
    if kind < 0.7:
        return rng.choice(WORDS)
    if kind < 0.9:
        letters = [chr(rng.choice((rng.randrange(32, 127), rng.randrange(0xD800), rng.randrange(0x10000, 0x10FFFF))))
                   for _ in range(rng.randrange(1, 12))]  # fmt: skip
        return "".join(letters)
    return rng.choice(("y", "é", "ab ", "1")) * round(10 ** rng.uniform(1, 5))


def number(rng: random.Random, old: float) -> Any:
    """A number near to an old one, or far from it."""
    kind = rng.randrange(8)
    try:
        return (
            rng.choice(NUMBERS), old * 10 ** rng.randrange(-9, 10), -old, math.nextafter(old, math.inf), float(old),
            round(old), old + rng.choice((-1, 1, 0.5)), rng.uniform(-1, 1) * 10 ** rng.uniform(-12, 12),
        )[kind]  # fmt: skip
    except (OverflowError, ValueError):
        return rng.choice(NUMBERS)


def _value(rng: random.Random, tree: Any, others: Sequence[Any]) -> None:
    """Another value of the same kind, or of another."""
    leaves = [(holder, key) for holder, key in parts(tree) if not isinstance(holder[key], dict | list)]
    if not leaves:
        return
    holder, key = rng.choice(leaves)
    old = holder[key]
    if rng.random() < 0.2:
        holder[key] = copy.deepcopy(rng.choice(OTHER_KINDS))
    elif isinstance(old, int | float) and not isinstance(old, bool):
        holder[key] = number(rng, old) if rng.random() < 0.9 else str(old)
    elif isinstance(old, str):
        holder[key] = word(rng) if rng.random() < 0.8 else rng.choice([there[what] for there, what in leaves])
    else:
        holder[key] = rng.choice(OTHER_KINDS)


def _key(rng: random.Random, tree: Any, others: Sequence[Any]) -> None:
    """A key that is gone, new, misspelt, or another's."""
    tables = [tree, *(h[k] for h, k in parts(tree) if isinstance(h[k], dict))]
    table = rng.choice([t for t in tables if isinstance(t, dict)] or [{}])
    keys = list(table)
    kind = rng.randrange(5)
    if kind == 0 or not keys:
        table[word(rng)] = copy.deepcopy(rng.choice(OTHER_KINDS))
        return
    key = rng.choice(keys)
    if kind == 1:
        del table[key]
    elif kind == 2:
        at = rng.randrange(len(key) + 1)
        table[key[:at] + rng.choice(("", "x", "_", " ", "é")) + key[at + 1 :]] = table.pop(key)
    elif kind == 3:
        other = rng.choice(keys)
        table[key], table[other] = table[other], table[key]
    else:
        table[word(rng)] = copy.deepcopy(table[key])


def _list(rng: random.Random, tree: Any, others: Sequence[Any]) -> None:
    """A list with entries that are gone, new, doubled or in another order."""
    lists = [h[k] for h, k in parts(tree) if isinstance(h[k], list)]
    if not lists:
        return _value(rng, tree, others)
    found = rng.choice(lists)
    kind = rng.randrange(6)
    if kind == 0 or not found:
        found.append(copy.deepcopy(rng.choice((*OTHER_KINDS, *NUMBERS, *found))))
    elif kind == 1:
        del found[rng.randrange(len(found))]
    elif kind == 2:
        found.clear()
    elif kind == 3:
        rng.shuffle(found)
    elif kind == 4:
        found[:] = found[: rng.randrange(len(found) + 1)]
    else:
        found.insert(rng.randrange(len(found) + 1), copy.deepcopy(rng.choice(found)))
    return None


def _part(rng: random.Random, tree: Any, others: Sequence[Any]) -> None:
    """A part of another place, or of another file, in place of one."""
    found = parts(tree)
    if not found:
        return
    holder, key = rng.choice(found)
    source = parts(rng.choice((tree, *others))) or found
    there, what = rng.choice(source)
    holder[key] = copy.deepcopy(there[what])


def _nest(rng: random.Random, tree: Any, others: Sequence[Any]) -> None:
    """A part within lists or tables, some or thousands."""
    found = parts(tree)
    if not found:
        return
    holder, key = rng.choice(found)
    if rng.random() < 0.5:
        for _ in range(rng.randrange(1, 40)):
            holder[key] = [holder[key]] if rng.random() < 0.7 else {word(rng): holder[key]}
    else:
        holder[key] = f"@nest{rng.choice('[{')}{round(10 ** rng.uniform(1, 5))}@"


def _scale(rng: random.Random, tree: Any, others: Sequence[Any]) -> None:
    """A part many times: entries of a list, keys of a table, letters of a text."""
    found = [(h, k) for h, k in parts(tree) if h[k] or isinstance(h[k], int | float)]
    if not found:
        return
    holder, key = rng.choice(found)
    part = holder[key]
    times = min(round(10 ** rng.uniform(1, 5)), MAX_REPEATED_BYTES // max(len(repr(part)), 1) + 1)
    if (isinstance(part, list) and rng.random() < 0.7) or (isinstance(part, str) and rng.random() < 0.7):
        holder[key] = part * times
    elif isinstance(part, dict) and part and rng.random() < 0.6:
        name, value = rng.choice(list(part.items()))
        part |= {f"{name}{k}": value for k in range(times)}
    elif isinstance(holder, dict) and rng.random() < 0.6:
        holder |= {f"{key}{k}": part for k in range(times)}
    else:
        holder[key] = [part] * times


CHANGES: tuple[tuple[Callable[[random.Random, Any, Sequence[Any]], None], int], ...] = (
    (_value, 200), (_key, 70), (_list, 55), (_part, 40), (_nest, 15), (_scale, 3),
)  # fmt: skip


def changed(rng: random.Random, tree: Any, others: Sequence[Any]) -> Any:
    """A tree with one to four changes."""
    root = [copy.deepcopy(tree)]
    kinds, weights = zip(*CHANGES, strict=True)
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 4))):
        change = rng.choices(kinds, weights)[0]
        # The tree itself may be replaced as well, now and then.
        change(rng, root if rng.random() < 0.02 or not isinstance(root[0], dict | list) else root[0], others)
        if change is _scale:
            break
    return root[0]


def text_of(rng: random.Random, tree: Any, toml: bool) -> bytes:
    """The text of a tree, with lines that are doubled, gone or exchanged in one of twelve."""
    if toml:
        text = tomli_w.dumps(_for_toml(tree) if isinstance(tree, dict) else {"x": _for_toml(tree)})
    else:
        text = json.dumps(tree, default=str, indent=rng.choice((None, 1)), ensure_ascii=rng.random() < 0.5)
    text = NEST.sub(lambda m: _nested(m[1], int(m[2]), toml), text)
    if rng.random() < 1 / 12:
        text = _slip(rng, text)
    return text.encode("utf-8", "surrogatepass")


def _nested(bracket: str, depth: int, toml: bool) -> str:
    if bracket == "[":
        return "[" * depth + "1" + "]" * depth
    return ('{"a":', "{a=")[toml] * depth + "1" + "}" * depth


def _for_toml(tree: Any) -> Any:
    """Without what TOML has no word for."""
    if isinstance(tree, dict):
        return {str(key): _for_toml(value) for key, value in tree.items()}
    if isinstance(tree, list):
        return [_for_toml(value) for value in tree]
    return "null" if tree is None else tree


def _slip(rng: random.Random, text: str) -> str:
    lines = text.split("\n")
    at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
    kind = rng.randrange(6)
    if kind == 0:
        lines[at:at] = [lines[other]] * rng.choice((1, 1, 1, 1000))
    elif kind == 1:
        del lines[at]
    elif kind == 2:
        lines[at], lines[other] = lines[other], lines[at]
    elif kind == 3:
        dotted = "a" + ".a" * round(10 ** rng.uniform(0, 5)) + " = 1"
        lines[at] = rng.choice(("[", "{", "]", '"""', "=", dotted, "x = 1979-13-32", "[[x]]"))
    elif kind == 4:
        return text[: rng.randrange(len(text) + 1)]
    else:
        place = rng.randrange(len(text) + 1)
        return text[:place] + word(rng) + text[place + rng.randrange(4) :]
    return rng.choice(("\n", "\n", "\n", "\r\n", "\r")).join(lines)
