"""MuJoCo's own contact terms, fitted as closely as possible to a model's cloth and impacts.

In: a model. Out: native terms, with separate ones for rails that differ.

Rolling friction is fitted to rolling balls, sliding and turning friction to all motions: rolling lasts longest, and a
rolling ball shows nothing else. Impacts are played as the file plays them, at its own time step, because the slate's
response to a ball that a nose presses down depends on the step; motions on the cloth, which agree to a millimetre in
3 s, are played by the faster steps of models/mujoco.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from models.effect import Effect
from models.mjcf.native import Native
from models.model_file import Model
from models.shot import RAIL_NAMES
from sysid.mjcf.player import play_plain
from sysid.mjcf.said import EXPRESSIBLE, OF_RAILS, at_rail, without
from sysid.validation.native_fit import TERMS_BY_CASE, start_of, tune


@dataclass(frozen=True)
class FittedTerms:
    """Native terms of a file."""

    native: Native
    of_rails: Mapping[str, Native]  # of the rails that differ, by RAIL_NAMES


def fit_terms(model: Model) -> FittedTerms:
    """The native terms closest to a model's motion; its own ones for contacts that no effect replaces."""
    level = without(model, EXPRESSIBLE)
    stack = level.stack()[1:]
    native, resolved = start_of(level), {e.resolves for e in stack}
    if any(e.slot == "cloth" for e in stack):
        native = tune("cloth", ("slide", "spin"), native, level)
        native = tune("rolling", ("roll",), native, level)
    if "ball" in resolved:
        native = tune("ball", TERMS_BY_CASE["ball"], native, level, play_plain)
    if "cushion" not in resolved:
        return FittedTerms(native, {})
    native = tune("cushion", TERMS_BY_CASE["cushion"], native, level, play_plain)
    found: dict[tuple[Effect, ...], Native] = {level.effects: native}
    of_rails = {}
    for rail in RAIL_NAMES:
        truth = without(at_rail(model, rail), [name for name in EXPRESSIBLE if name not in OF_RAILS])
        if truth.effects not in found:
            noses = tuple(e for e in truth.effects if e.name() in OF_RAILS)
            found[truth.effects] = tune(
                "cushion", TERMS_BY_CASE["cushion"], native, truth, play_plain, noses
            )  # fmt: skip
        if found[truth.effects] is not native:
            of_rails[rail] = found[truth.effects]
    return FittedTerms(native, of_rails)
