"""The Python reference and the catalogue of effects as pages: `python -m tests.architecture.reference` writes them.

In: the public names of the packages and the effects, with their docstrings. Out: docs/reference.md and
docs/catalogue.md, plain Markdown, which is read in the repository as on the site. A test holds them up to date.
"""

from __future__ import annotations

import dataclasses
import inspect
import sys
from collections.abc import Iterator
from typing import Any

import models
import planner
import sysid
from models.contract.checks import described
from models.effect_catalogue import catalogue
from tests.architecture.source import ROOT

PACKAGES = (models, sysid, planner)
HEAD = "<!-- Written by: python -m tests.architecture.reference -->\n"


def reference() -> str:
    """Every public name with its arguments and what it is."""
    about = "From the docstrings. Quantities are in SI units unless a name says otherwise.\n"
    parts = ["# Python reference\n", HEAD, about]
    for package in PACKAGES:
        parts += [f"## {package.__name__}\n", _words(package) + "\n"]
        for name in package.__all__:
            parts += _entry(f"{package.__name__}.{name}", getattr(package, name))
    return "\n".join(parts)


def _entry(name: str, value: Any) -> Iterator[str]:
    """A function, or a class with its fields and methods."""
    yield f"### {name}\n"
    yield f"```python\n{_signature(name.rpartition('.')[2], value)}\n```\n"
    yield _words(value) + "\n"
    if not inspect.isclass(value):
        return
    rows = []
    for key, member in sorted(vars(value).items()):
        plain = member.fget if isinstance(member, property) else getattr(member, "func", member)
        plain = getattr(plain, "__func__", plain)
        if key.startswith("_") or not inspect.isfunction(plain) or not plain.__doc__:
            continue
        is_value = isinstance(member, property) or hasattr(member, "attrname")
        call = key if is_value else _signature(key, plain)
        rows.append(f"* `{' '.join(call.split())}`: {plain.__doc__.strip().splitlines()[0]}")
    if rows:
        yield "\n".join(rows) + "\n"


def _signature(name: str, value: Any) -> str:
    """How it is called, without annotations: the docstring says what each argument is."""
    if inspect.isclass(value) and dataclasses.is_dataclass(value):
        taken = [f.name if _needed(f) else f"{f.name}=..." for f in dataclasses.fields(value) if f.init]
        return f"{name}({', '.join(taken)})"
    try:
        found = inspect.signature(value)
    except (TypeError, ValueError):
        return f"{name}(...)"
    taken = [p.replace(annotation=p.empty) for p in found.parameters.values() if p.name not in ("self", "cls")]
    plain = [p.replace(default=_Dots()) if inspect.isfunction(p.default) else p for p in taken]
    return f"{name}{found.replace(parameters=plain, return_annotation=found.empty)}"


def _needed(field: Any) -> bool:
    return field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING


class _Dots:
    """A default that is not shown."""

    def __repr__(self) -> str:
        """Where a default is a function."""
        return "..."


def _words(value: Any) -> str:
    """A docstring, its sections of arguments as lists."""
    lines, out, section = (inspect.getdoc(value) or "").splitlines(), list[str](), ""
    for line in lines:
        if line in ("Args:", "Returns:", "Raises:"):
            section = line
            out.append(f"{line}\n" if line != "Returns:" else line)
        elif section and line.startswith("    ") and not line.startswith("     ") and section != "Returns:":
            key, colon, text = line.strip().partition(":")
            out.append(f"* `{key}`:{text}" if colon else f"* {line.strip()}")
        else:
            section = section if line.startswith(" ") or not line else ""
            out.append(f"  {line.strip()}" if section and line.strip() else line)
    return "\n".join(line.rstrip() for line in out)


def effects() -> str:
    """Formula, source and parameters of every effect."""
    parts = [
        "# The catalogue of effects\n", HEAD,
        "Formula, source and parameters of every effect, from its file. `sysid effects` prints the same.\n"
        "`off` is the value at which the effect vanishes.\n",
    ]  # fmt: skip
    for name, kind in sorted(catalogue().items()):
        about = described(kind)
        text = (sys.modules[kind.__module__].__doc__ or kind.__doc__ or "").strip()
        parts += [f"## {name}\n", text + "\n", f"Hooks: {', '.join(about['doors']) or 'none'}.\n"]
        rows = ["| parameter | usual | off | bounds | unit | source |", "|---|---|---|---|---|---|"]
        for key, meta in kind.parameters().items():
            off = "" if meta["off"] is None else f"{meta['off']:g}"
            low, high = meta["bounds"]
            unit, source = meta["unit"], meta["source"].replace("|", "\\|")
            rows.append(f"| `{key}` | {meta['default']:g} | {off} | {low:g} to {high:g} | {unit} | {source} |")
        parts += ["\n".join(rows) + "\n"] if len(rows) > 2 else []
    return "\n".join(parts)


PAGES = {"docs/reference.md": reference, "docs/catalogue.md": effects}


def main() -> None:
    """Write the pages."""
    for name, page in PAGES.items():
        (ROOT / name).write_text(page(), encoding="utf-8")


if __name__ == "__main__":
    main()
