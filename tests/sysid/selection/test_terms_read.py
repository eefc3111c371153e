"""Terms that are read from an earlier result: found again, and refused where they are none."""

from __future__ import annotations

import ast
import math
from pathlib import Path
from typing import Any

import pytest

import models.effect_catalogue
from models.effect_catalogue import add_folder, effect_class
from models.errors import BadInput
from sysid.selection.formulas.description import source_from
from sysid.selection.formulas.terms import Term
from sysid.selection.formulas.terms_read import term_from_json
from tests.support.clip_samples import refusal
from tests.support.formula_terms import TERMS, terms_of, told


@pytest.mark.parametrize("term", [*TERMS[::7], *terms_of("ball_mu_with_2")], ids=lambda t: t.name)
def test_a_term_of_a_result_is_found_again(term: Term) -> None:
    found, value = term_from_json(told(term, term.width))
    assert (found.name, found.quantity, found.factor, found.unit, found.kind, found.constants, value) == (
        term.name, term.quantity, term.factor, term.unit, term.kind, term.constants, term.width
    )  # fmt: skip


EVIL = "__import__('os').system('touch evil')"
HOSTILE = [
    ("door", f"drag'{EVIL}"), ("door", "side"), ("door", None), ("factor", EVIL), ("factor", f"cos(heading) + {EVIL}"),
    ("factor", f"cos(heading)\n{EVIL}"), ("factor", "np.cos(heading)"), ("factor", "x" * 100_000), ("name", EVIL),
    ("name", "drag_cos: float = 1\n    x"), ("name", "drag_cos2"), ("name", 3), ("name", ["drag_cos"]),
    ("value", EVIL), ("value", math.nan), ("value", math.inf), ("value", True), ("value", 10**400), ("value", 1e300),
]  # fmt: skip


@pytest.mark.parametrize(("key", "text"), HOSTILE, ids=range(len(HOSTILE)))
def test_a_hostile_term_is_refused(key: str, text: Any) -> None:
    entry = told(terms_of("drag_cos")[0]) | {key: text}
    line = refusal(lambda: source_from("odd_cloth", {"terms": [entry], "what": "it", "where": "here"}, "a test"))
    assert "name a result.json" in line and line.isprintable() and len(line) < 600


@pytest.mark.parametrize(
    "factor",
    [
        f"abs(x - {EVIL}) <= 0.3000 and abs(y - 0.1000) <= 0.3000", "abs(x - 1e99) <= 0.3000 and abs(y - 0.1) <= 0.3",
        "abs(x - 0.1000) <= 0.3000 and abs(y - 0.1000) <= 0.3000\n",
        "abs(x - ٣.٣٣٣٣) <= 0.3000 and abs(y - 0.1000) <= 0.3000",
    ],
)  # fmt: skip
def test_a_cell_is_read_as_numbers_alone(factor: str) -> None:
    entry = told(terms_of("drag_at_1_1")[0]) | {"factor": factor}
    with pytest.raises(BadInput, match="no term 'drag_at_1_1' on 'drag'"):
        term_from_json(entry)


@pytest.mark.parametrize(
    "formula", [{"terms": "drag"}, {"terms": [1]}, {"terms": [told(TERMS[0])] * 2}, {"terms": [told(t) for t in TERMS]}]
)
def test_a_formula_that_is_none_is_refused(formula: dict[str, Any]) -> None:
    refusal(lambda: source_from("odd_cloth", {"what": "it", "where": "here"} | formula, "a test"))
    refusal(lambda: source_from("odd_cloth", {"terms": [told(TERMS[0])], "what": 1, "where": "here"}, "a test"))
    refusal(lambda: source_from("Odd: x", {"terms": [told(TERMS[0])], "what": "it", "where": "here"}, "a test"))


SPITEFUL = [
    f'"""\n{EVIL}\n"""',
    f'" + {EVIL} + "',
    "ends in \\",
    'ends in "',
    f"{{{EVIL}}} %s \\N{{DEGREE}} \x00\u2028\ud800",
]


@pytest.mark.parametrize("text", SPITEFUL, ids=range(len(SPITEFUL)))
def test_words_of_a_result_stay_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str) -> None:
    """Quotes, backslashes and line breaks in what a result or a file's name says neither break nor run."""
    monkeypatch.setattr(models.effect_catalogue, "_added", {})
    monkeypatch.chdir(tmp_path)
    entry = told(terms_of("drag_at_1_1")[0]) | {"unit": text, "where": text, "depends_on": [text], "width": text}
    written = source_from("odd_cloth", {"terms": [entry], "what": text, "where": text, "form": text}, text)
    tree = ast.parse(written.encode())
    assert " ".join(text.split())[:20] in (ast.get_docstring(tree, clean=False) or "").replace("\n", " ")
    assert [type(node).__name__ for node in tree.body] == ["Expr", *["ImportFrom"] * 4, "ClassDef"]
    called = {n.func.id for n in ast.walk(tree) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)}
    assert called <= {"param", "push_along", "until_edge", "abs", "dataclass"}
    path = tmp_path / "odd_cloth.py"
    path.write_bytes(written.encode())
    add_folder(path)
    assert effect_class("odd_cloth").parameters()["drag_at_1_1"]["unit"] == "m/s^2"
    assert not (tmp_path / "evil").exists()
