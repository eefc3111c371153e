"""A record, within a file, of the command and the input that made it.

In: a file's bytes. Out: the same with the record, or the record that they hold. It stands where readers of such
files pass over it: in a comment of TOML, XML and PDF, a key of JSON, a text of PNG. It holds a digest of the rest,
too: a file that was changed by hand is no longer what the command made.
"""

from __future__ import annotations

import hashlib
import json
import re
import struct
import zlib
from collections.abc import Callable, Mapping
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path

DIGEST_CHARS = 16
TEXT = rb"made by ([a-z -]+): ([0-9a-f]{%d}) ([0-9a-f]{%d})" % (DIGEST_CHARS, DIGEST_CHARS)
PNG_END = b"\x00\x00\x00\x00IEND\xaeB`\x82"


@dataclass(frozen=True)
class Origin:
    """What a result is made by and from."""

    command: str  # "sysid fit"
    inputs: str  # a digest of its options and of all that it reads


@dataclass(frozen=True)
class _Kind:
    """How a kind of file holds a record."""

    begins: bytes
    found: re.Pattern[bytes]  # the record with what it stands in
    added: Callable[[bytes, bytes], bytes]  # content and text -> content with the record


def _in_json(content: bytes, text: bytes) -> bytes:
    body = content.rstrip().removesuffix(b"}").rstrip()
    return body + (b"" if body == b"{" else b",") + b'\n "made": "' + text + b'"\n}\n'


def _in_png(content: bytes, text: bytes) -> bytes:
    chunk = b"tEXtSource\0" + text
    whole = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
    return content.removesuffix(PNG_END) + whole + PNG_END


KINDS = (  # the last is that of all other texts
    _Kind(b"{", re.compile(rb',?\n "made": "' + TEXT + rb'"(?=\n\}\n\Z)'), _in_json),
    _Kind(b"\x89PNG", re.compile(rb"(?s)....tEXtSource\0" + TEXT + rb"....(?=\0\0\0\0IEND)"), _in_png),
    _Kind(b"%PDF", re.compile(rb"\n% " + TEXT + rb"\n\Z"), lambda content, text: content + b"\n% " + text + b"\n"),
    _Kind(
        b"<",
        re.compile(rb"\n<!-- " + TEXT + rb" -->\n\Z"),
        lambda content, text: content + b"\n<!-- " + text + b" -->\n",
    ),
    _Kind(b"", re.compile(rb"\n# " + TEXT + rb"\n\Z"), lambda content, text: content + b"\n# " + text + b"\n"),
)


def with_record(content: bytes, origin: Origin) -> bytes:
    """A file's content with the record of its origin."""
    kind = next(kind for kind in KINDS if content.startswith(kind.begins))
    text = f"made by {origin.command}: {origin.inputs} {_digest(content, kind)}"
    return kind.added(content, text.encode())


def origin_of(content: bytes) -> Origin | None:
    """The origin by a file's record; None where it has none, or was changed since."""
    kind = next(kind for kind in KINDS if content.startswith(kind.begins))
    found = kind.found.search(content)
    if found is None:
        return None
    command, inputs, rest = (text.decode() for text in found.groups())
    return Origin(command, inputs) if _digest(kind.found.sub(b"", content), kind) == rest else None


def _digest(content: bytes, kind: _Kind) -> str:
    """Of a content without a record, as a reader of its kind takes it."""
    if kind.begins == b"{":
        content = json.dumps(json.loads(content), sort_keys=True).encode()
    return hashlib.sha256(content).hexdigest()[:DIGEST_CHARS]


expected: ContextVar[Mapping[Path, Origin] | None] = ContextVar("expected", default=None)  # by real path
