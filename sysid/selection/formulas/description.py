"""A sparse formula as `unexplained` of result.json has it, and as the text of an effect file.

In: a `SparseFormula`, and a fit with it. Out: its place, dependences, size, terms and curves.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from models.analytic import factors as kinds
from models.errors import BadInput
from models.formula import MAX_TERMS
from models.variables import VARIABLES
from sysid.estimation.fitted import FittedModel
from sysid.estimation.problem import Array
from sysid.selection.formulas.effect_file import effect_source
from sysid.selection.formulas.formula import EFFECT_NAME, SparseFormula
from sysid.selection.formulas.terms import (
    PLACE_DIGITS,
    QUANTITY_TEXTS,
    VARIABLE_UNITS,
    Shape,
    Term,
    condition,
)
from sysid.selection.formulas.terms_read import RESULT_REMEDY, term_from_json
from sysid.selection.scoring.evidence import Evidence


def describe(found: SparseFormula, fitted: FittedModel | None, evidence: Evidence | None) -> dict[str, Any]:
    """The formula as `unexplained` of result.json: place, dependences, size, terms."""
    names = [f"{EFFECT_NAME}.{t.name}" for t in found.terms]
    if fitted is not None:
        found = found.placed(fitted)
        values, sds = zip(*(fitted.value(n) for n in names), strict=True)
    else:
        values, sds = tuple(found.values), tuple([float("nan")] * len(names))
    first = found.terms[0]
    depends = list(dict.fromkeys(word for t in found.terms for word in t.depends_on))
    places = [(t.place, g) for t, g in zip(found.terms, found.improvements, strict=True) if t.place is not None]
    where = first.where
    place: dict[str, Any] = {}
    if first.place is not None:
        weight = np.array([g for _, g in places])
        centre = weight @ np.array([p for p, _ in places]) / weight.sum()
        where = f"on the cloth around x = {centre[0]:.2f} m, y = {centre[1]:.2f} m"
        place["place_m"] = [float(v) for v in centre]
    sd_of = {
        t: math.inf if t.kind == kinds.HAT and not s <= t.width else s for t, s in zip(found.terms, sds, strict=True)
    }
    value_of = dict(zip(found.terms, values, strict=True))
    for group in found.groups:
        value_of |= _bridged(group, value_of, sd_of)
    form = "; ".join(_in_words(group, value_of, sd_of) for group in found.groups)
    size = max((float(value_of[t]) for t in found.groups[0]), key=abs)
    return {
        "where": where, "depends_on": depends, "size": size, "unit": first.unit,
        "what": QUANTITY_TEXTS[first.quantity], "form": form,
        "delta_bic": float(evidence.delta_bic) if evidence else float(sum(found.improvements)),
        "terms": [
            {"name": t.name, "door": t.quantity, "factor": t.factor, "unit": t.unit, "width": t.width,
             "value": float(value_of[t]), "sd": float(sd_of[t]) if np.isfinite(sd_of[t]) else None, "where": t.where,
             "depends_on": list(t.depends_on), "gain": g, **_places_of(t, fitted)}
            for t, g in zip(found.terms, found.improvements, strict=True)
        ],
        "curves": [_curve(group, value_of, sd_of) for group in found.groups if group[0].kind == kinds.HAT],
        "alike": list(dict.fromkeys(word for words in found.alike for word in words)),
        **place,
    }  # fmt: skip


def _bridged(group: Shape, values: Mapping[Term, float], sds: Mapping[Term, float]) -> dict[Term, float]:
    """Values at a curve's nodes that the clips leave undetermined: on straight lines between the others."""
    if group[0].kind != kinds.HAT or not any(math.isfinite(sds[t]) for t in group):
        return {}
    nodes = _nodes(_curve(group, values, sds))
    return {t: float(np.interp(t.constants[1], nodes[:, 0], nodes[:, 1])) for t in group if math.isinf(sds[t])}


def _nodes(curve: Mapping[str, Any]) -> Array:
    """Places and values (n, 2) at the nodes of a curve that the clips determine; at all nodes if at none."""
    every = np.array([curve["at"], curve["value"]]).T
    known = np.array([sd is not None for sd in curve["sd"]])
    return every[known] if any(curve["sd"]) else every  # the middle of some has an sd of 0


def _in_words(group: Shape, values: Mapping[Term, float], sds: Mapping[Term, float]) -> str:
    """A formula in words: terms with coefficients, curves by their values at the nodes that the clips determine."""
    if group[0].kind != kinds.HAT:
        return "; ".join(f"{QUANTITY_TEXTS[t.quantity]}: {values[t]:+.4g} * ({t.factor})" for t in group)
    curve = _curve(group, values, sds)
    points = ", ".join(f"{v:+.3g} at {at:g}" for at, v in _nodes(curve).tolist())
    unit = f" {curve['variable_unit']}" if curve["variable_unit"] != "1" else ""
    return f"{curve['quantity']}, a curve of {curve['variable']}: {points}{unit}, linear between these"


def _curve(group: Shape, values: Mapping[Term, float], sds: Mapping[Term, float]) -> dict[str, Any]:
    """A curve for result.json: its values with standard deviations at the nodes."""
    at, value, sd = ([of(t) for t in group] for of in (lambda t: t.constants[1], values.__getitem__, sds.__getitem__))
    if len(group) % 2 == 0:  # it is 0 at its middle
        middle = len(at) // 2
        at.insert(middle, round(at[middle] - group[middle].constants[2], PLACE_DIGITS) + 0.0)
        value.insert(middle, 0.0)
        sd.insert(middle, 0.0)
    variable = VARIABLES[int(group[0].constants[0])]
    name, _, unit = QUANTITY_TEXTS[group[0].quantity].partition(" [")
    where = "" if group[0].only is None else f" where {condition(group[0].only)}"
    if group[0].times is not None:
        where, unit = f"{where}, times {group[0].times}", f"{group[0].unit}]"
    return {
        "quantity": f"{name}{where}{unit and f' [{unit}'}", "variable": variable,
        "variable_unit": VARIABLE_UNITS.get(variable, "1"), "at": at, "value": [float(v) for v in value],
        "sd": [float(v) if np.isfinite(v) else None for v in sd],
    }  # fmt: skip


def _places_of(term: Term, fitted: FittedModel | None) -> dict[str, Any]:
    """The place of a term's step, or its decay scale, as `at` of result.json, and `from` where it begins to act."""
    found: dict[str, Any] = {"at": term.constants[1], "at_sd": 0.0} if term.kind == kinds.HAT else {}
    if fitted is not None:
        for place in term.places:
            at, sd = fitted.value(f"{EFFECT_NAME}.{place.name}")
            key = "at" if place.field == "b" else "from"
            found |= {key: at, f"{key}_sd": sd if np.isfinite(sd) else None}
    return found


def source_from(name: str, described: dict[str, Any], origin: str) -> str:
    """The text of an effect file for a formula from `describe`, with terms of the library.

    Raises:
        BadInput: for anything else.
    """
    entries, what, where = (described.get(key) for key in ("terms", "what", "where"))
    if not isinstance(entries, list) or not 0 < len(entries) <= MAX_TERMS:
        raise BadInput(f"the unexplained structure has no list of 1 to {MAX_TERMS} terms; {RESULT_REMEDY}")
    terms, values = zip(*(term_from_json(entry) for entry in entries), strict=True)
    if len({t.name for t in terms}) < len(terms):
        raise BadInput(f"the unexplained structure has a term twice; {RESULT_REMEDY}")
    if not isinstance(what, str) or not isinstance(where, str):
        raise BadInput(f"the unexplained structure has no text for what and where; {RESULT_REMEDY}")
    return effect_source(name, terms, values, f"SparseFormula found in clips: {what}, {where}.", origin)
