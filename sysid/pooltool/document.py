"""pooltool's files as plain values: JSON, and MessagePack with numpy's arrays as msgpack-numpy packs them.

An array is a map with the keys nd, type, shape and data; a file is read within the limits of models/files/limits.py.
MessagePack needs the package msgpack, which pooltool itself uses; JSON needs none.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from models.errors import BadInput, one_line
from models.files import limits, parse, read_text, write_whole
from models.files.documents import file_problem
from models.files.faults import Faults

SYSTEM_REMEDY = "name a file of pooltool's System.save, .json or .msgpack"
SYSTEM_KEYS = {"cue", "table", "balls", "t", "events"}
MULTISYSTEM_KEY = "multisystem"
HEAD_CHARS = 400  # beginning of a JSON file that contains the first key
MESSAGEPACK_SUFFIX = ".msgpack"


def is_pooltool(path: Path) -> bool:
    """Whether a file is pooltool's, by its name or its beginning."""
    if path.suffix.lower() == MESSAGEPACK_SUFFIX:
        return True
    if path.suffix.lower() != ".json" or not path.is_file():
        return False
    try:
        with path.open("rb") as file:
            head = file.read(HEAD_CHARS).decode("utf-8-sig", errors="replace").split()
    except OSError:
        return False
    return "".join(head).startswith(('{"cue":{"id":', f'{{"{MULTISYSTEM_KEY}":'))


def read_systems(path: Path) -> list[Mapping[str, Any]]:
    """The systems of a file, one or several; BadInput if it holds none."""
    data = _messagepack(path) if path.suffix.lower() == MESSAGEPACK_SUFFIX else _json(path)
    many = data.get(MULTISYSTEM_KEY) if isinstance(data, dict) else None
    systems = many if isinstance(many, list) else [data]
    if not systems or not all(isinstance(one, dict) and one.keys() >= SYSTEM_KEYS for one in systems):
        raise BadInput(f"{path}: contains no pooltool system: {SYSTEM_REMEDY}")
    return systems


def write_document(data: Mapping[str, Any], path: Path) -> None:
    """Write plain values as .json or .msgpack, by the name's suffix, completely or not at all."""
    suffix = path.suffix.lower()
    if suffix == MESSAGEPACK_SUFFIX:
        content: bytes = _library(path).packb(_without_histories(data))
    elif suffix == ".json":
        content = (json.dumps(data, indent=2) + "\n").encode()
    else:
        raise BadInput(f"{path}: pooltool reads .json and .msgpack: use one of these suffixes")
    write_whole(path, content, parents=True)


def _without_histories(value: Any) -> Any:
    """Plain values with None instead of empty histories, as pooltool stores them."""
    if value == {"states": []}:
        return None
    return {key: _without_histories(v) for key, v in value.items()} if isinstance(value, Mapping) else value


def _json(path: Path) -> Any:
    faults = Faults()
    text = faults.settle(read_text(path, str(path), faults, SYSTEM_REMEDY, limits.MAX_TRACKS_JSON_BYTES))
    return faults.settle(parse(text, str(path), faults, json.loads))


def _messagepack(path: Path) -> Any:
    library = _library(path)
    if problem := file_problem(path, SYSTEM_REMEDY, limits.MAX_TRACKS_JSON_BYTES):
        raise BadInput(f"{path}: {problem}")
    try:
        return library.unpackb(path.read_bytes(), object_hook=_array)
    except (OSError, ValueError, TypeError, library.exceptions.UnpackException, RecursionError) as error:
        raise BadInput(f"{path}: is not valid MessagePack ({one_line(str(error))}): save it again") from error


def _array(found: dict[Any, Any]) -> Any:
    """The array or number that a map encodes, or the map itself."""
    if b"nd" not in found:
        return found
    kind = np.dtype(str(found[b"type"]))
    if kind.kind not in "fiub":
        raise ValueError(f"an array of {kind}")
    values = np.frombuffer(found[b"data"], kind)
    if not found[b"nd"]:
        return values[0].item()
    shape = tuple(int(n) for n in found[b"shape"])
    if math.prod(shape) != values.size:
        raise ValueError("an array whose size differs from its shape")
    return values.reshape(shape)


def _library(path: Path) -> ModuleType:
    try:
        import msgpack
    except ImportError as error:
        raise BadInput(f"{path}: MessagePack needs msgpack: pip install 'cuelab[pooltool]', or use JSON") from error
    return msgpack
