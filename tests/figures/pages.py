"""Marked figures in Markdown pages, and the file that they are filled from.

A figure stands in a page as `<!--demo.base-->2.16 mm<!---->`: a comment with its key, what the reader sees, an empty
comment. Quantities that are given and not measured (a rule, a setting, a size) stand as `<!--given-->12 ft<!---->`.
docs/figures.toml has a table for every source: the command that measured it, the date, the version, a note, and its
figures as the pages show them.
"""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT / "docs" / "figures.toml"
HEAD = "# Measured figures of README.md and docs/; `make figures` fills the pages. How to enter more: CONTRIBUTING.md."
MARKED = re.compile(r"<!--([a-z_]+)\.([a-z0-9_]+)-->(.*?)<!---->", re.DOTALL)
GIVEN = re.compile(r"<!--given-->.*?<!---->", re.DOTALL)
UNITS = (
    r"%|°|[cm]?m\b|px\b|pixels?\b|m?s\b|seconds?\b|min\b|minutes?\b|h\b|hours?\b|[kMG]B\b|"
    r"times\b|m?rad\b|degrees?\b|points?\b|frames/s|R\b"
)
QUANTITY = re.compile(rf"\d[\d.,]*[ \n]?(?:{UNITS})|\d \+- \d|\b\d+ of \d+\b|\b\d+\.\d+\b")
ALL_SOURCES = ("figures", "sources")  # the mark of the table of when each was measured
Sources = dict[str, dict[str, Any]]


def pages() -> list[Path]:
    """Those that may hold figures."""
    return [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def read_figures(path: Path = DATA) -> Sources:
    """Every source: `command`, `date`, `version`, `note` where there is one, and `figures`, text by name."""
    return tomllib.loads(path.read_text(encoding="utf-8"))


def write_figures(sources: Sources, path: Path = DATA) -> None:
    """The file anew."""
    path.write_text(f"{HEAD}\n\n{tomli_w.dumps(sources)}", encoding="utf-8")


def filled(text: str, sources: Mapping[str, Mapping[str, Any]]) -> str:
    """A page with its marked figures as they are now; KeyError names one that is not in the file."""

    def figure(found: re.Match[str]) -> str:
        source, name, _ = found.groups()
        if (source, name) == ALL_SOURCES:
            return f"<!--{source}.{name}-->\n\n{table_of_sources(sources)}\n\n<!---->"
        if name not in sources.get(source, {}).get("figures", {}):
            raise KeyError(f"{source}.{name} is not in {DATA.name}")
        return f"<!--{source}.{name}-->{sources[source]['figures'][name]}<!---->"

    return MARKED.sub(figure, text)


def table_of_sources(sources: Mapping[str, Mapping[str, Any]]) -> str:
    """When each source was measured, of which version, and by which command."""
    lines = ["| figures of | date | version | measured by |", "|---|---|---|---|"]
    for name, source in sources.items():
        note = f"; {source['note']}" if "note" in source else ""
        lines.append(f"| {name} | {source['date']} | {source['version']} | `{source['command']}`{note} |")
    return "\n".join(lines)


def used(text: str) -> set[tuple[str, str]]:
    """Sources and names of the figures of a page."""
    return {(source, name) for source, name, _ in MARKED.findall(text)} - {ALL_SOURCES}


def unmarked_cells(text: str) -> list[str]:
    """Cells of tables of figures that hold digits beside marks; the first column says what was measured.

    A table of figures has a marked one in some cell.
    """
    found = []
    for block in re.findall(r"(?:^\|.*\n?)+", text, re.MULTILINE):
        if MARKED.search(block.replace("\n", " ")):
            for line in block.splitlines()[2:]:
                cells = line.strip().strip("|").split("|")[1:]
                found += [
                    cell.strip() for cell in cells if re.search(r"\d", _plain(GIVEN.sub("", MARKED.sub("", cell))))
                ]
    return found


def unmarked_quantities(text: str) -> list[str]:
    """Quantities of a page's prose that are neither marked nor given; of a table's first column none is measured."""
    prose = re.sub(
        r"^\|[^|\n]*\|", "", re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE), flags=re.MULTILINE
    )
    return QUANTITY.findall(_plain(GIVEN.sub("", MARKED.sub("", prose))))


def _plain(text: str) -> str:
    """A text without addresses of links and names of code."""
    return re.sub(r"\]\([^)]*\)|`[^`]*`", "", text)
