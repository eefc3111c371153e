"""Every way to break a formula of `models/` by one small change, found in the syntax tree.

A change is a sign, a factor, a comparison, a swapped axis or function, a constant doubled. What only says how finely
or fast something is computed is no physics and is left out, since no observable should tell it from another choice:
functions of step lengths (STEP_LENGTHS), iteration limits (`range`), conditions that end an iteration (`if ...:
break`), literals that are rounding or no bound at all (outside SMALLEST to LARGEST), and what these or a named
tolerance (TOLERANCES) are added to or multiplied with. Comparisons with a tolerance stay in: they tell sliding from
rolling.
"""

from __future__ import annotations

import ast
import copy
import dataclasses
import random
import re
from collections import Counter
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
STEP_LENGTHS = ("horizon", "_reach", "_fade")  # functions of how long a step may be
TOLERANCES = re.compile(
    r"SETTLED|TOLERANCE|STILL|SNAP|ALIGNED|CLOSED_GAP|STRAIGHT_SINE|SETBACK|MARGIN|MAX_STEPS|MAX_SLIP|LAST_SLIP"
    r"|^none$|^fine$"
)  # names that hold one
SMALLEST, LARGEST = 1e-5, 1e5  # of literals that are physics
AXIS_ENDINGS = ("vx", "vy", "wx", "wy", "_x", "_y", ".x", ".y")  # of names that have another axis


@dataclass(frozen=True)
class Mutant:
    """One change: in which file and function, what it was and what it became, and the file's new text."""

    file: str
    function: str
    before: str
    after: str
    text: str
    line: int
    copy: int = 0  # which of the same changes in the function

    @property
    def name(self) -> str:
        """Where and what, as one line that knows no line numbers."""
        again = f" ({self.copy + 1})" if self.copy else ""
        return f"{self.file} {self.function}: {self.before}  ->  {self.after}{again}"


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


def _is_tolerance(node: ast.AST) -> bool:
    """Whether a value is about rounding or iterations, or a multiple of such a one."""
    if isinstance(node, ast.BinOp):
        return _is_tolerance(node.left) or _is_tolerance(node.right)
    if isinstance(node, ast.Constant):
        return isinstance(node.value, float) and node.value != 0.0 and not SMALLEST < abs(node.value) < LARGEST
    name = node.id if isinstance(node, ast.Name) else node.attr if isinstance(node, ast.Attribute) else ""
    return bool(TOLERANCES.search(name))


def _is_left_out(node: ast.AST) -> bool:
    """What is no formula, or only about steps, iterations and rounding."""
    if isinstance(node, ast.Raise | ast.Assert | ast.JoinedStr | ast.arguments):
        return True
    if isinstance(node, ast.FunctionDef):
        return node.name in STEP_LENGTHS
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        return node.func.id == "range"
    if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
        return bool(TOLERANCES.search(node.targets[0].id))
    return isinstance(node, ast.BinOp | ast.Constant) and _is_tolerance(node)


def _formulas(function: ast.FunctionDef) -> Iterator[ast.AST]:
    """Nodes of a function's body, without docstrings, annotations, checks that raise, and what `_is_left_out`."""
    stack: list[ast.AST] = [] if _is_left_out(function) else list(function.body)
    while stack:
        node = stack.pop()
        if _is_left_out(node):
            continue
        yield node
        if isinstance(node, ast.If) and any(isinstance(inner, ast.Raise | ast.Break) for inner in node.body):
            stack.extend(node.orelse)
        elif isinstance(node, ast.AnnAssign):
            stack.extend([node.value] if node.value else [])
        elif not isinstance(node, ast.FunctionDef):
            stack.extend(ast.iter_child_nodes(node))


def mutants(root: Path, path: Path) -> list[Mutant]:
    """All of one file, in the order of its lines."""
    source = path.read_text(encoding="utf-8")
    lines = source.splitlines(keepends=True)
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line.encode()))
    raw = source.encode()
    found = []
    functions = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.FunctionDef)]
    for function, node in ((one, node) for one in functions for node in _formulas(one)):
        for other in _changed(node):
            begin = starts[node.lineno - 1] + node.col_offset  # type: ignore[attr-defined]
            end = starts[node.end_lineno - 1] + node.end_col_offset  # type: ignore[attr-defined]
            before, after = raw[begin:end].decode(), ast.unparse(ast.fix_missing_locations(other))
            inside = after if isinstance(node, ast.AugAssign) else f"({after})"
            text = (raw[:begin] + inside.encode() + raw[end:]).decode()
            line = int(node.lineno)  # type: ignore[attr-defined]
            file = str(path.relative_to(root))
            found.append((begin, Mutant(file, function.name, " ".join(before.split()), after, text, line)))
    counts: Counter[str] = Counter()
    numbered = []
    for _, one in sorted(found, key=lambda pair: (pair[0], pair[1].before, pair[1].after)):
        numbered.append(dataclasses.replace(one, copy=counts[one.name]))
        counts[one.name] += 1
    return numbered


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
