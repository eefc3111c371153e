"""A record within a file of the command and the input that made it.

In: a file's bytes. Out: the same with a record, or the record in them. It is in a place that readers ignore: a comment
in TOML, XML and PDF, a key in JSON, a text in PNG. It includes a digest of the rest, so that a file changed by hand no
longer counts as the command's.
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
RECORD_RE = rb"made by ([a-z -]+): ([0-9a-f]{%d}) ([0-9a-f]{%d})" % (DIGEST_CHARS, DIGEST_CHARS)
PNG_END = b"\x00\x00\x00\x00IEND\xaeB`\x82"


@dataclass(frozen=True)
class Origin:
    """The origin of a result: its command and input."""

    command: str  # "sysid fit"
    inputs: str  # digest of its options and of everything that it reads


@dataclass(frozen=True)
class _Kind:
    """The way in which a kind of file stores a record."""

    begins: bytes
    found: re.Pattern[bytes]  # the record with its surroundings
    added: Callable[[bytes, bytes], bytes]  # content and text -> content with the record


def _in_json(content: bytes, text: bytes) -> bytes:
    body = content.rstrip().removesuffix(b"}").rstrip()
    return body + (b"" if body == b"{" else b",") + b'\n "made": "' + text + b'"\n}\n'


def _in_png(content: bytes, text: bytes) -> bytes:
    chunk = b"tEXtSource\0" + text
    whole = struct.pack(">I", len(chunk) - 4) + chunk + struct.pack(">I", zlib.crc32(chunk))
    return content.removesuffix(PNG_END) + whole + PNG_END


FILE_FORMATS = (  # the last is for all other texts
    _Kind(b"{", re.compile(rb',?\n "made": "' + RECORD_RE + rb'"(?=\n\}\n\Z)'), _in_json),
    _Kind(b"\x89PNG", re.compile(rb"(?s)....tEXtSource\0" + RECORD_RE + rb"....(?=\0\0\0\0IEND)"), _in_png),
    _Kind(b"%PDF", re.compile(rb"\n% " + RECORD_RE + rb"\n\Z"), lambda content, text: content + b"\n% " + text + b"\n"),
    _Kind(
        b"<",
        re.compile(rb"\n<!-- " + RECORD_RE + rb" -->\n\Z"),
        lambda content, text: content + b"\n<!-- " + text + b" -->\n",
    ),
    _Kind(b"", re.compile(rb"\n# " + RECORD_RE + rb"\n\Z"), lambda content, text: content + b"\n# " + text + b"\n"),
)


def with_record(content: bytes, origin: Origin) -> bytes:
    """A file's content with the record of its origin."""
    kind = next(kind for kind in FILE_FORMATS if content.startswith(kind.begins))
    text = f"made by {origin.command}: {origin.inputs} {_digest(content, kind)}"
    return kind.added(content, text.encode())


def origin_of(content: bytes) -> Origin | None:
    """The origin in a file's record; None if it has none, or was changed since."""
    kind = next(kind for kind in FILE_FORMATS if content.startswith(kind.begins))
    found = kind.found.search(content)
    if found is None:
        return None
    command, inputs, rest = (text.decode() for text in found.groups())
    return Origin(command, inputs) if _digest(kind.found.sub(b"", content), kind) == rest else None


def _digest(content: bytes, kind: _Kind) -> str:
    """Digest of a content without a record, as a reader of its kind sees it."""
    if kind.begins == b"{":
        content = json.dumps(json.loads(content), sort_keys=True).encode()
    return hashlib.sha256(content).hexdigest()[:DIGEST_CHARS]


expected: ContextVar[Mapping[Path, Origin] | None] = ContextVar("expected", default=None)  # by real path
