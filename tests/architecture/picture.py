"""The architecture, drawn from the code: `python -m tests.architecture.picture` writes architecture.svg.

A band is a package, a box one of its rooms (a folder, or all files at the package's top) with the first sentence of its
docstring. An arrow leads from a room to what it is made from; those that follow from two others are left out, and so
are arrows between bands, as each package may use all that are above it. A test holds the picture up to date.
"""

from __future__ import annotations

import ast
import html
import sys
import textwrap
from pathlib import Path

from tests.architecture.source import FLOW, ROOT, imports, sources

PICTURE = "architecture.svg"
BOX_WIDTH, BOX_HEIGHT, GAP_X, GAP_Y, MARGIN = 214, 104, 54, 20, 24  # [px]
WRAP_CHARACTERS, MAX_LINES = 34, 5
TOP = "(top)"  # the room of files that lie in no folder of their package
TINTS = {"models": "#e8f0e4", "sysid": "#e4ecf5", "planner": "#f6efe0", "robot": "#f3e6e6"}


def room_of(module: str, package: str) -> str:
    """The room that a module of a package lies in."""
    parts = module.split(".")[1:]
    folder = ROOT / package / parts[0] if parts else None
    return parts[0] if folder is not None and (folder / "__init__.py").is_file() else TOP


def rooms_of(package: str) -> dict[str, set[str]]:
    """Rooms of a package, and which others of it each imports."""
    found: dict[str, set[str]] = {}
    for path in sources(package):
        module = ".".join(path.relative_to(ROOT).with_suffix("").parts)
        if module == f"{package}.__init__":
            continue
        used = {room_of(name, package) for name in imports(path) if name.startswith(f"{package}.")}
        room = room_of(module.removesuffix(".__init__"), package)
        found.setdefault(room, set()).update(used - {room})
    return found


def columns(needs: dict[str, set[str]]) -> list[list[str]]:
    """Rooms column by column, each right of all that it imports; files at the top stand right of what they import."""
    plain = {room: used - {TOP} for room, used in needs.items() if room != TOP}
    placed: list[list[str]] = []
    while plain:
        free = sorted(room for room, used in plain.items() if not used & plain.keys())
        if not free:
            raise ValueError(f"rooms that import each other: {', '.join(sorted(plain))}")
        placed.append(free)
        for room in free:
            del plain[room]
    if TOP in needs:
        users = [k for k, column in enumerate(placed) for room in column if TOP in needs[room]]
        if users and not needs[TOP]:
            placed.insert(0, [TOP])
        else:
            used = [k for k, column in enumerate(placed) for room in column if room in needs[TOP]]
            after = max(used, default=-1) + 1
            if after < len(placed):
                placed[after].append(TOP)
            else:
                placed.append([TOP])
    return placed


def direct(needs: dict[str, set[str]]) -> set[tuple[str, str]]:
    """Imports (from, to) that do not follow from others."""

    def reached(room: str) -> set[str]:
        return {far for near in needs.get(room, ()) for far in {near} | reached(near)}

    without_top = {room: used - {TOP} for room, used in needs.items() if room != TOP}
    needs = without_top
    return {
        (room, used)
        for room, all_used in needs.items()
        for used in all_used
        if not any(used in reached(other) for other in all_used - {used})
    }


def summary(package: str, room: str) -> str:
    """The first sentence of a room's docstring; of the top, its files."""
    if room == TOP:
        return ", ".join(path.stem for path in sorted((ROOT / package).glob("*.py")) if path.stem != "__init__")
    text = ast.get_docstring(ast.parse((ROOT / package / room / "__init__.py").read_text(encoding="utf-8"))) or ""
    return " ".join(text.split("\n\n")[0].split()).split(". ")[0].rstrip(".")


def drawing() -> str:
    """The picture as SVG."""
    shapes: list[str] = []
    y = MARGIN
    width = 0
    for package in FLOW:
        needs = rooms_of(package)
        laid_out = columns(needs)
        rows = max(len(column) for column in laid_out)
        height = rows * (BOX_HEIGHT + GAP_Y) + GAP_Y + 30
        corner: dict[str, tuple[int, int]] = {}
        for k, column in enumerate(laid_out):
            for row, room in enumerate(column):
                corner[room] = (2 * MARGIN + k * (BOX_WIDTH + GAP_X), y + 30 + GAP_Y // 2 + row * (BOX_HEIGHT + GAP_Y))
        band = 2 * MARGIN + len(laid_out) * (BOX_WIDTH + GAP_X)
        width = max(width, band)
        shapes.append(f'<rect x="{MARGIN}" y="{y}" width="BAND" height="{height}" rx="8" fill="{TINTS[package]}"/>')
        shapes.append(f'<text x="{MARGIN + 12}" y="{y + 22}" class="package">{package}</text>')
        for user, used in sorted(direct(needs)):
            (x1, y1), (x2, y2) = corner[user], corner[used]
            shapes.append(_arrow(x1, y1 + BOX_HEIGHT // 2, x2 + BOX_WIDTH, y2 + BOX_HEIGHT // 2))
        for room, (x, top) in corner.items():
            shapes.append(_box(x, top, package if room == TOP else room, summary(package, room), room == TOP))
        y += height + GAP_Y
    full = width + 2 * MARGIN
    body = "\n".join(shapes).replace("BAND", str(full - 2 * MARGIN))
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{full}" height="{y + MARGIN}" '
        f'viewBox="0 0 {full} {y + MARGIN}" font-family="sans-serif" font-size="12">\n'
        "<title>cuelab: packages, rooms and their imports</title>\n"
        '<defs><marker id="head" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        '<path d="M0,0 L8,4 L0,8 z" fill="#667"/></marker></defs>\n'
        "<style>.package{font-size:17px;font-weight:bold}.room{font-weight:bold}"
        ".line{fill:none;stroke:#667;stroke-width:1.2;marker-end:url(#head)}</style>\n"
        f'<rect width="{full}" height="{y + MARGIN}" fill="white"/>\n{body}\n'
        f'<text x="{MARGIN}" y="{y + 8}">An arrow leads from a room to what it imports; each package may also import '
        "those above it.</text>\n</svg>\n"
    )


def _box(x: int, y: int, name: str, text: str, top: bool) -> str:
    lines = textwrap.wrap(text, WRAP_CHARACTERS)
    if len(lines) > MAX_LINES:
        lines = [*lines[: MAX_LINES - 1], f"{lines[MAX_LINES - 1][: WRAP_CHARACTERS - 3]}..."]
    title = f"files of {name}/" if top else f"{name}/"
    dash = ' stroke-dasharray="4 3"' if top else ""
    rows = "".join(f'<tspan x="{x + 10}" dy="15">{html.escape(line)}</tspan>' for line in lines)
    return (
        f'<rect x="{x}" y="{y}" width="{BOX_WIDTH}" height="{BOX_HEIGHT}" rx="5" fill="white" stroke="#667"{dash}/>'
        f'<text x="{x + 10}" y="{y + 19}" class="room">{title}</text><text x="{x + 10}" y="{y + 22}">{rows}</text>'
    )


def _arrow(x1: int, y1: int, x2: int, y2: int) -> str:
    """From the left side of a box to the right side of another; past boxes between them, through the gap below."""
    if x1 - x2 <= GAP_X:
        bend = (x1 - x2) // 2
        return f'<path class="line" d="M{x1},{y1} C{x1 - bend},{y1} {x2 + bend},{y2} {x2 + 2},{y2}"/>'
    near, far, gap = x1 - GAP_X // 3, x2 + GAP_X // 3, y2 + (BOX_HEIGHT + GAP_Y) // 2
    low = BOX_HEIGHT // 4
    return f'<path class="line" d="M{x1},{y1 + low} H{near} V{gap} H{far} V{y2 + low} H{x2 + 2}"/>'


def main() -> int:
    """Write the picture beside README.md."""
    path = Path(ROOT / PICTURE)
    path.write_text(drawing(), encoding="utf-8")
    print(f"written: {path.name}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
