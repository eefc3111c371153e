"""Functions compiled by numba, kept on disk: `@compiled`, and callbacks that compiled code calls by their address.

numba's own cache knows a function by the file that holds it, and not what that function calls or which constants it
reads; then a program would go on running what was changed elsewhere. Here the cache is stamped with the text of all
compiled files, and lies beside them, or in the user's cache folder where that cannot be written. Nothing is compiled
by an import; the first call does it.
"""

from __future__ import annotations

import hashlib
import os
import re
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numba
from numba.core import caching, ccallback, compiler

MODELS_FOLDER = Path(__file__).parent
CACHE_NAME = "compiled"  # in __pycache__ beside the source
NUMBA_OPTIONS = {"error_model": "numpy", "nogil": True, "_nrt": True}


IMPORT_LINE = re.compile(rb"^from models(\.[\w.]+)? import (\w+)?", re.MULTILINE)


def sources() -> list[Path]:
    """Files of this package that hold compiled functions, and those that they import constants from."""
    texts = {path: path.read_bytes() for path in sorted(MODELS_FOLDER.rglob("*.py"))}
    found = {path for path, text in texts.items() if b"\n@compiled" in text}
    pairs = {pair for path in found for pair in IMPORT_LINE.findall(texts[path])}
    names = {name for package, first in pairs for name in (package, package + b"." + first)}  # a module, or from one
    used = {MODELS_FOLDER.joinpath(*name.decode().split(".")).with_suffix(".py") for name in names - {b""}}
    return sorted(found | (used & texts.keys()))


@cache
def stamp() -> str:
    """A digest of the sources of compiled code."""
    digest = hashlib.sha256(numba.__version__.encode())
    for path in sources():
        digest.update(str(path.relative_to(MODELS_FOLDER)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


@cache
def cache_folder(beside: Path) -> Path | None:
    """Where compiled code of the sources in a folder is kept; None where nothing can be written."""
    if chosen := os.environ.get("NUMBA_CACHE_DIR"):
        home = Path(chosen)
    else:
        home = Path(os.environ.get("XDG_CACHE_HOME") or Path("~/.cache").expanduser())
    name = hashlib.sha256(str(beside.resolve()).encode()).hexdigest()[:12]
    for folder in (beside / "__pycache__" / CACHE_NAME, home / "cuelab" / name):
        if _writable(folder):
            return folder
    return None


class _Locator(caching._CacheLocator):
    """Compiled code beside its source, valid while no compiled file has changed."""

    def __init__(self, function: Callable[..., Any], file: str, folder: Path) -> None:
        self._py_file, self._folder = file, folder
        self._line = function.__code__.co_firstlineno

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return hashlib.sha256(stamp().encode() + Path(self._py_file).read_bytes()).hexdigest()

    def get_disambiguator(self) -> str:
        return str(self._line)

    @classmethod
    def from_function(cls, py_func: Callable[..., Any], py_file: str) -> _Locator | None:
        path = Path(py_file)
        folder = cache_folder(path.parent) if path.is_file() else None
        return None if folder is None else cls(py_func, py_file, folder)


class _Results(caching.CompileResultCacheImpl):
    _locator_classes = (_Locator,)


class _Cache(caching.FunctionCache):
    _impl_class = _Results

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Compiled code for a signature; None, and what is kept is dropped, where it names what is no longer there.

        numba reads the types in an index before it compares stamps: those of other sources may have gone since.
        """
        try:
            return super().load_overload(sig, target_context)
        except (AttributeError, ImportError):
            self.flush()
            return None


def _kept(function: Callable[..., Any]) -> Any:
    """The cache of a function; one that keeps nothing where there is no place for it."""
    try:
        return _Cache(function)
    except RuntimeError:  # no locator
        return caching.NullCache()


def compiled(function: Callable[..., Any]) -> Any:
    """Compile a function on its first call, without the GIL while it runs, and keep it on disk."""
    return _dispatcher(function, NUMBA_OPTIONS)


def compiled_in_place(function: Callable[..., Any]) -> Any:
    """The same for a function that makes no array: it does not count who holds those it is handed.

    Counting is atomic, at some 20 ns for every array that is passed on and every row that is taken of one: more than
    most functions of the engine take otherwise. numba refuses to compile one that makes an array after all.
    """
    return _dispatcher(function, {**NUMBA_OPTIONS, "_nrt": False})


def compiled_within(function: Callable[..., Any]) -> Any:
    """The same for a part of one long function: it is compiled into its caller, and costs no call."""
    return _dispatcher(function, {**NUMBA_OPTIONS, "_nrt": False, "forceinline": True})


def compiled_sums(function: Callable[..., Any]) -> Any:
    """The same where sums may be taken in any order, which is fixed by the compiler: four at a time."""
    return _dispatcher(function, {**NUMBA_OPTIONS, "fastmath": {"reassoc", "contract", "nsz"}})


def _dispatcher(function: Callable[..., Any], options: dict[str, Any]) -> Any:
    dispatcher = numba.njit(**options)(function)
    dispatcher._cache = _kept(function)
    return dispatcher


def callback(function: Callable[..., Any], signature: Any) -> Any:
    """A function compiled for one signature, whose `address` compiled code can call."""
    args = signature.args, signature.return_type
    options = {"error_model": "numpy"}
    found: Any = ccallback.CFunc(function, args, locals={}, options=options, pipeline_class=compiler.Compiler)
    found._cache = _kept(function)
    found.compile()
    return found


ALL_CODE = "ready"
COMPILING_NOTE = "compiling the engine, once on this machine: about a minute"


def is_ready(part: str = ALL_CODE) -> bool:
    """Whether compiled code of these sources, or a part of it, is on disk already."""
    mark = _mark(part)
    return mark is not None and mark.exists()


def set_ready(part: str = ALL_CODE) -> None:
    """Note that everything, or a part, has been compiled once."""
    if (mark := _mark(part)) is not None and not mark.exists():
        mark.touch()


def note_compiling(part: str = ALL_CODE) -> None:
    """Say on standard error that code will be compiled, where it, or a part that is needed, is not on disk yet."""
    if not is_ready() and not is_ready(part):
        print(COMPILING_NOTE, file=sys.stderr, flush=True)


def _mark(part: str) -> Path | None:
    folder = cache_folder(MODELS_FOLDER / "engine")
    return None if folder is None else folder / f"{part}-{stamp()[:16]}-{sys.version_info[1]}"


__all__ = [
    "cache_folder", "callback", "compiled", "compiled_in_place", "compiled_sums", "compiled_within", "is_ready",
    "note_compiling", "set_ready", "stamp",
]  # fmt: skip
