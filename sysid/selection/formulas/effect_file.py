"""The text of an effect file for a sparse formula.

In: terms (terms.py) with their coefficients, a title, and where they come from. Out: the text of a Python module with
one `Effect`, as `sysid new-effect --from` writes it.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence

from models import formula as doors
from models.analytic import factors as kinds
from models.effect import MIN_FRICTION_SHARE
from models.errors import BadInput
from models.variables import SESSION_VARIABLES, X, Y
from sysid.selection.formulas.terms import QUANTITY_TEXTS, Term

EFFECT_NAME_PATTERN = re.compile(r"[a-z][a-z0-9]*(_[a-z0-9]+)*")
LINE_CHARS = 120
EFFECT_TEMPLATE = '''"""{title}

{formula}
Source: {source}.
"""

from __future__ import annotations

{imports}


@dataclass(frozen=True)
class {kind}(Effect):
    """{short}"""

'''
# The variables of a factor as expressions of each hook's state.
MOTION_VARIABLES = {
    "x": "ball.x", "y": "ball.y", "wz": "ball.wz", "speed": "hypot(ball.vx, ball.vy)",
    "heading": "atan2(ball.vy, ball.vx)", "time": "ball.time", "number": "ball.number",
    "slip": "hypot(ball.slip_x, ball.slip_y)", **{name: f"ball.{name}" for name in SESSION_VARIABLES},
}  # fmt: skip
IMPACT_VARIABLES = {
    "x": "hit.x", "y": "hit.y", "wz": "hit.wz", "time": "hit.time", "slip": "hit.slip",
    "approach": "hit.approach", "grazing": "grazing_sine(hit.vx, hit.vy, hit.approach)",
    "number": "hit.first", "first": "hit.first", "second": "hit.second",
    "rail": "hit.second", "along": "hit.y if hit.second < 2 else hit.x",
    **{name: f"hit.{name}" for name in SESSION_VARIABLES},
}  # fmt: skip
IMAGE_VARIABLES = {
    "x": "image.x", "y": "image.y", "time": "image.time", "number": "image.number",
    **{name: f"image.{name}" for name in SESSION_VARIABLES},
}  # fmt: skip
APPLY_LINES = {  # quantity: the line that changes it
    "drag": "push_along(ball, -{value}, 0.0)",
    "grip": f"ball.slide_factor = max(ball.slide_factor * (1.0 + {{value}}), {MIN_FRICTION_SHARE})",
    "spin": f"ball.spin_factor = max(ball.spin_factor * (1.0 + {{value}}), {MIN_FRICTION_SHARE})",
    "push_x": "ball.ax += {value}",
    "push_y": "ball.ay += {value}",
    "side": "push_along(ball, 0.0, {value})",
    "cushion_e": "hit.restitution += {value}",
    "cushion_mu": "hit.friction += {value}",
    "ball_e": "hit.restitution += {value}",
    "ball_mu": "hit.friction += {value}",
    "image_x": "image.x += {value}",
    "image_y": "image.y += {value}",
    "clock": "late = {value}\n        image.x, image.y = image.x + late * image.vx, image.y + late * image.vy",
}
APPLY_CONDITIONS = {  # the condition under which a quantity changes
    ("drag", "side"): "ball.rolling", ("push_x", "push_y"): "ball.weight > 0",
    ("cushion_e", "cushion_mu"): "hit.cushion", ("ball_e", "ball_mu"): "not hit.cushion",
}  # fmt: skip


def escape_text(text: str) -> str:
    """Text escaped for a quoted Python string, on one line."""
    one_line = " ".join(text.encode("utf-8", "replace").decode().split())
    return "".join(
        f"\\{c}" if c in '"\\' else c if c.isprintable() else c.encode("unicode_escape").decode() for c in one_line
    )


def effect_source(name: str, terms: Sequence[Term], values: Sequence[float], title: str, origin: str) -> str:
    """The text of an effect file with these terms, coefficients at these values.

    `terms` come from `library` or `term_from_json`; title and origin may be any text.
    """
    if not EFFECT_NAME_PATTERN.fullmatch(name):
        raise BadInput(f"{name!r} is not a valid effect name; use lowercase words joined by _")
    title, origin = escape_text(title), escape_text(origin)
    parts = []
    for t, value in zip(terms, values, strict=True):
        part = t.part(float(f"{value:.6g}"), "")
        low, high = part.bounds
        declared = (
            f'{part.default!r}, off=0.0, unit="{escape_text(t.unit)}", bounds=({low!r}, {high!r}), source="{origin}"'
        )
        line = f"    {t.name}: float = param({declared})\n"
        parts.append(
            line if len(line) <= LINE_CHARS + 1 else f"    {t.name}: float = param(\n        {declared}\n    )\n"
        )
    parts += _hook(terms, "forces(self, ball: BallState)", "Forces on a ball.", MOTION_VARIABLES)
    parts += _horizon(terms)
    parts += _hook(terms, "impact(self, hit: ImpactState)", "Changes at a contact.", IMPACT_VARIABLES)
    parts += _hook(terms, "observe(self, image: ImageState)", "Changes of the reported position.", IMAGE_VARIABLES)
    body = "".join(parts)
    lines = [_wrapped(f"{QUANTITY_TEXTS[t.quantity]}: {t.name} * {_bracketed(t.factor)}") for t in terms]
    head = EFFECT_TEMPLATE.format(
        title=_wrapped(title), formula="\n".join(lines),
        source=_wrapped(f"Source: {origin}").removeprefix("Source: "), imports=_imports(body),
        kind="".join(word.capitalize() for word in name.split("_")), short=_wrapped(title, 4).lstrip(),
    )  # fmt: skip
    return head + body


def _wrapped(text: str, indent: int = 0) -> str:
    return textwrap.fill(
        text, LINE_CHARS - 4, break_long_words=False, break_on_hyphens=False, initial_indent=indent * " ",
        subsequent_indent=indent * " ",
    )  # fmt: skip


def _bracketed(factor: str) -> str:
    """A factor, in brackets if multiplication needs them."""
    return factor if re.fullmatch(r"\w+(\([^()]*\)|\.\d+)?", factor) else f"({factor})"


def _words(text: str) -> set[str]:
    return set(re.findall(r"\b[A-Za-z_]\w*", text))


def _hook(terms: Sequence[Term], signature: str, summary: str, variables: dict[str, str]) -> list[str]:
    """The lines of a hook with the terms of its quantities; empty without terms."""
    codes = {"forces": doors.CLOTH, "impact": doors.IMPACTS, "observe": doors.IMAGE}[signature.partition("(")[0]]
    here = [t for t in terms if 1 + doors.TERM_HOOKS.index(t.quantity) in codes]
    if not here:
        return []
    needed = set().union(*(_words(t.factor) for t in here))
    lines = [f"\n    def {signature} -> None:\n", f'        """{summary}"""\n']
    lines += [f"        {word} = {text}\n" for word, text in variables.items() if word in needed]
    for t in here:
        line = APPLY_LINES[t.quantity].format(value=f"self.{t.name} * {_bracketed(t.factor)}")
        case = next((text for these, text in APPLY_CONDITIONS.items() if t.quantity in these), "")
        lines.append(f"        if {case}:\n            {line}\n" if case else f"        {line}\n")
    return lines


def on_cloth(term: Term) -> bool:
    """Whether a term acts on balls on the cloth."""
    return 1 + doors.TERM_HOOKS.index(term.quantity) in doors.CLOTH


def lines(term: Term) -> list[tuple[int, float]]:
    """Variable x or y and place of the lines on the cloth at which a term steps, bends, or begins to act."""
    found = [(int(term.constants[0]), term.constants[1])] if term.kind in (kinds.ABOVE, kinds.BEND) else []
    found += [(term.only.variable, term.only.which)] if term.only is not None else []
    return [(variable, at) for variable, at in found if on_cloth(term) and variable in (X, Y)]


def bends(term: Term) -> bool:
    """Whether a term is a hat function that acts on the cloth."""
    return on_cloth(term) and term.kind == kinds.HAT


def _horizon(terms: Sequence[Term]) -> list[str]:
    found = [f"until_edge(ball, {', '.join(map(repr, t.constants))})" for t in terms if t.kind == kinds.BOX]
    found += [f"until_line(ball, {float(variable)!r}, {at!r})" for t in terms for variable, at in lines(t)]
    found += [f"until_bend(ball, {', '.join(map(repr, t.constants[:3]))})" for t in terms if bends(t)]
    if not found:
        return []
    least = found[0] if len(found) == 1 else "min(\n            " + ",\n            ".join(found) + ",\n        )"
    return [
        "\n    def horizon(self, ball: BallState) -> float:\n",
        '        """Time until the ball is where the force switches or bends [s]."""\n',
        f"        return {least}\n",
    ]


def _imports(body: str) -> str:
    """The import lines that a body needs."""
    needed = _words(body) | {"Effect"}
    offered = {
        "math": ("atan2", "cos", "exp", "hypot", "sin"),
        "dataclasses": ("dataclass",),
        "models.effect": ("BallState", "Effect", "ImageState", "ImpactState", "param", "push_along"),
        "models.analytic.crossings": ("until_bend", "until_edge", "until_line"),
        "models.variables": ("grazing_sine",),
    }
    needed |= {"dataclass"}
    chosen = {module: [n for n in names if n in needed] for module, names in offered.items()}
    lines = {module: f"from {module} import {', '.join(names)}" for module, names in chosen.items() if names}
    ours = [lines[m] for m in sorted(lines) if m.startswith("models")]
    return "\n".join([lines[m] for m in sorted(lines) if not m.startswith("models")]) + "\n\n" + "\n".join(ours)
