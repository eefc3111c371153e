"""Every way to break a formula of `models/` by one small change, found in the syntax tree."""

from __future__ import annotations

import ast
import copy
import random
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

FORMULAS = ("models/analytic", "models/effects")  # with all below them
MORE_FORMULAS = ("impacts.py", "increments.py", "spring.py")  # wherever in models/ they are
SIGNS: dict[type[ast.operator], type[ast.operator]] = {ast.Add: ast.Sub, ast.Sub: ast.Add}
FACTORS: dict[type[ast.operator], type[ast.operator]] = {ast.Mult: ast.Div, ast.Div: ast.Mult}
ORDERS: dict[type[ast.cmpop], type[ast.cmpop]] = {ast.Lt: ast.Gt, ast.Gt: ast.Lt, ast.LtE: ast.GtE, ast.GtE: ast.LtE}
FUNCTIONS = {"sin": "cos", "cos": "sin", "min": "max", "max": "min"}
AXES = {"x": "y", "y": "x"}
AXIS_ENDINGS = ("vx", "vy", "wx", "wy", "_x", "_y", ".x", ".y")  # of names that have another axis


@dataclass(frozen=True)
class Mutant:
    """One change: in which file and line, what it was and what it became, and the file's new text."""

    file: str
    line: int
    before: str
    after: str
    text: str

    @property
    def name(self) -> str:
        """Where and what, as one line."""
        return f"{self.file}:{self.line}: {self.before}  ->  {self.after}"


def formula_files(root: Path) -> list[Path]:
    """Sources that hold formulas."""
    found = {path for folder in FORMULAS for path in (root / folder).rglob("*.py")}
    found |= {path for name in MORE_FORMULAS for path in (root / "models").rglob(name)}
    return sorted(path for path in found if path.name != "__init__.py")


def _changed(node: ast.AST) -> Iterator[ast.AST]:
    """Nodes that may stand in place of this one."""
    if isinstance(node, ast.BinOp):
        for table in (SIGNS, FACTORS):
            if type(node.op) in table:
                other = copy.copy(node)
                other.op = table[type(node.op)]()
                yield other
    elif isinstance(node, ast.AugAssign) and type(node.op) in SIGNS:
        changed = copy.copy(node)
        changed.op = SIGNS[type(node.op)]()
        yield changed
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
        yield node.operand
    elif isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in ORDERS:
        order = copy.copy(node)
        order.ops = [ORDERS[type(node.ops[0])]()]
        yield order
    elif isinstance(node, ast.Constant) and isinstance(node.value, float) and node.value not in (0.0, 1.0):
        yield ast.copy_location(ast.Constant(node.value * 2), node)
    elif isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute | ast.Name):
        name = node.func.attr if isinstance(node.func, ast.Attribute) else node.func.id
        if name in FUNCTIONS:
            call = copy.deepcopy(node)
            assert isinstance(call.func, ast.Attribute | ast.Name)
            if isinstance(call.func, ast.Attribute):
                call.func.attr = FUNCTIONS[name]
            else:
                call.func.id = FUNCTIONS[name]
            yield call
    elif isinstance(node, ast.Attribute) and isinstance(node.ctx, ast.Load) and f".{node.attr}".endswith(AXIS_ENDINGS):
        axis = copy.copy(node)
        axis.attr = node.attr[:-1] + AXES[node.attr[-1]]
        yield axis


def _formulas(tree: ast.Module) -> Iterator[ast.AST]:
    """Nodes of function bodies, without docstrings, annotations, checks that raise, and declarations."""
    stack: list[ast.AST] = [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)]
    seen: set[int] = set()
    while stack:
        node = stack.pop()
        if id(node) in seen or isinstance(node, ast.Raise | ast.Assert | ast.JoinedStr | ast.arguments):
            continue
        seen.add(id(node))
        yield node
        if isinstance(node, ast.FunctionDef):
            stack.extend(node.body)
        elif isinstance(node, ast.If) and any(isinstance(inner, ast.Raise) for inner in node.body):
            stack.extend(node.orelse)
        elif isinstance(node, ast.AnnAssign):
            stack.extend([node.value] if node.value else [])
        else:
            stack.extend(ast.iter_child_nodes(node))


def mutants(root: Path, path: Path) -> list[Mutant]:
    """All of one file."""
    source = path.read_text(encoding="utf-8")
    lines = source.splitlines(keepends=True)
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line.encode()))
    raw = source.encode()
    found = []
    for node in _formulas(ast.parse(source)):
        for other in _changed(node):
            begin = starts[node.lineno - 1] + node.col_offset  # type: ignore[attr-defined]
            end = starts[node.end_lineno - 1] + node.end_col_offset  # type: ignore[attr-defined]
            before, after = raw[begin:end].decode(), ast.unparse(ast.fix_missing_locations(other))
            inside = after if isinstance(node, ast.AugAssign) else f"({after})"
            text = (raw[:begin] + inside.encode() + raw[end:]).decode()
            line = int(node.lineno)  # type: ignore[attr-defined]
            found.append(Mutant(str(path.relative_to(root)), line, " ".join(before.split()), after, text))
    return sorted(found, key=lambda m: (m.line, m.before, m.after))


def sample(root: Path, count: int, seed: int) -> list[Mutant]:
    """A random choice over all files: files in turn, so that long ones do not take all the places."""
    chance = random.Random(seed)
    by_file = [mutants(root, path) for path in formula_files(root)]
    for group in by_file:
        chance.shuffle(group)
    chosen: list[Mutant] = []
    while len(chosen) < count and any(by_file):
        chance.shuffle(by_file)
        for group in by_file:
            if group and len(chosen) < count:
                chosen.append(group.pop())
    return chosen
