"""The catalogue of effects: those that are shipped below `models/effects`, and those of a user's folders.

In: folders or files of effects, with names. Out: effects by name; `BadInput` for a file that cannot be read, an effect
that is not declared as one, and a name that is taken or unknown.
"""

from __future__ import annotations

import dataclasses
import hashlib
import importlib
import pkgutil
import sys
import traceback
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from types import ModuleType

import models.effects
from models.effect import Effect
from models.errors import BadInput
from models.files import read_text
from models.files.faults import Faults, shown


@cache
def _shipped() -> dict[str, type[Effect]]:
    found: dict[str, type[Effect]] = {}
    for module in pkgutil.walk_packages(models.effects.__path__, "models.effects."):
        for kind in _defined(importlib.import_module(module.name)):
            found[kind.name()] = kind
    return found


_added: dict[Path, tuple[bytes, tuple[type[Effect], ...]]] = {}  # by file: its text, and the effects of a user there


def catalogue() -> dict[str, type[Effect]]:
    """Every effect of the shipped folder and of the folders added, by name."""
    own = {kind.name(): kind for _, kinds in _added.values() for kind in kinds}
    return dict(sorted((_shipped() | own).items()))


def own_texts() -> list[bytes]:
    """The texts of the files of effects that were added."""
    return [text for _, (text, _) in sorted(_added.items())]


def own_file(kind: type[Effect]) -> Path | None:
    """The file of a user's effect; None for one that is shipped."""
    return next((file for file, (_, kinds) in _added.items() if kind in kinds), None)


def _defined(module: ModuleType) -> list[type[Effect]]:
    """The effects that a module defines, not those it imports."""
    members = vars(module).values()
    return [k for k in members if isinstance(k, type) and issubclass(k, Effect) and k.__module__ == module.__name__]


def add_folder(path: Path | str) -> tuple[str, ...]:
    """Let a user's folder of effects, or one file, join the catalogue; returns their names.

    Tests and files whose names begin with _ are left alone; a file that has not changed is not read again. BadInput
    names the file that cannot be imported, whose effect is not declared as one, or whose name is taken.
    """
    path = Path(path).resolve()
    if not path.exists():
        raise BadInput(f"{path}: no such folder; name the folder that holds your effects")
    files = sorted(path.glob("*.py")) if path.is_dir() else [path]
    files = [f for f in files if not f.name.startswith(("_", "test_", "conftest"))]
    found = {file: _read_effects(file) for file in files}
    taken = {"native": Path(__file__)} | {name: Path(str(_file(kind))) for name, kind in _shipped().items()}
    gone = [f for f in _added if f in found or (f.parent == path and not f.exists())]
    taken |= {k.name(): file for file, (_, kinds) in _added.items() for k in kinds if file not in gone}
    for file, (_, kinds) in found.items():
        for kind in kinds:
            if kind.name() in taken:
                raise BadInput(f"{file}: the name {kind.name()} is taken by {taken[kind.name()]}; rename the class")
            taken[kind.name()] = file
    names = tuple(kind.name() for _, kinds in found.values() for kind in kinds)
    if not names:
        raise BadInput(f"{path}: defines no effect; begin one with: sysid new-effect NAME --dir {path}")
    for file in gone:
        del _added[file]
    _added.update(found)
    return names


def _file(kind: type[Effect]) -> str | None:
    return sys.modules[kind.__module__].__file__


def _read_effects(file: Path) -> tuple[bytes, tuple[type[Effect], ...]]:
    """A user's file: its text and its effects."""
    faults = Faults()
    text = faults.settle(read_text(file, str(file), faults, "name a folder or a .py file")).encode()
    if file in _added and _added[file][0] == text:
        return _added[file]
    name = f"own_effects_{hashlib.sha256(str(file.parent).encode()).hexdigest()[:8]}_{file.stem}"
    module = ModuleType(name)
    module.__file__ = str(file)
    before = sys.modules.get(name)
    sys.modules[name] = module  # dataclasses and pickle look there
    try:
        exec(compile(text, str(file), "exec"), vars(module))
        kinds = tuple(_defined(module))
        fault = next((f for f in map(_undeclared, kinds) if f), "")
    except (Exception, SystemExit) as error:
        line = getattr(error, "lineno", None) if isinstance(error, SyntaxError) else None
        for frame, number in traceback.walk_tb(error.__traceback__):
            line = number if frame.f_code.co_filename == str(file) else line
        if before is None:
            del sys.modules[name]
        said = " ".join(str(error.msg if isinstance(error, SyntaxError) else error).split())
        where = f"{file} line {line}" if line else f"{file}"
        raise BadInput(f"{where}: {type(error).__name__}: {said}; correct it, or move the file") from error
    if fault:
        raise BadInput(f"{file}: {fault}")
    return text, kinds


def _undeclared(kind: type[Effect]) -> str:
    """The reason why a class is not an effect; "" for an effect."""
    if not dataclasses.is_dataclass(kind) or "__dataclass_fields__" not in vars(kind):
        return f"{kind.__name__} is no dataclass; put @dataclass(frozen=True) above it"
    for f in dataclasses.fields(kind):
        lacking = [k for k in ("off", "unit", "bounds", "source") if k not in f.metadata]
        if lacking or f.default is dataclasses.MISSING:
            return f"{kind.__name__}.{f.name} is not declared; write {f.name}: float = param(default, off=..., ...)"
    return ""


def effect_class(name: str) -> type[Effect]:
    """The effect of that name; BadInput with the nearest choices otherwise."""
    known = catalogue()
    if name not in known:
        near = get_close_matches(name, known, 1)
        hint = f"did you mean {near[0]}?" if near else "see sysid effects, or name its folder (--effects)"
        raise BadInput(f"unknown effect {shown(name)}; {hint}")
    return known[name]
