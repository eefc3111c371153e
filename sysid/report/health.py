"""What a fitted model says about the table, the balls and the camera, in plain words for their owner.

In: a fitted `Model` with its estimates. Out: `HealthLine`s, each a constant beside typical values and a verdict.

A constant is judged by its interval of two standard deviations to either side, and only where that is narrower than
the range of typical values; slopes, cushions and the camera, whose typical value is zero, only where they differ from
zero by more than three standard deviations. A fit that did not converge has no standard deviations and says nothing.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from models.model_file import Model
from sysid.report.finding import NOT_DETERMINED, Finding, HealthLine
from sysid.report.judges import judged

NOT_CONVERGED_LINE = "the fit did not converge: it says nothing about the table"


def health(model: Model) -> list[HealthLine]:
    """A line for every fitted constant with a known range or meaning, those with a verdict first."""
    if not model.fitted.get("converged", False):
        return []
    found = []
    for name, value in model.parameters().items():
        known = model.estimates.get(name)
        if known is None or np.ndim(value) or not math.isfinite(known.sd) or known.sd <= 0:
            continue
        line = judged(name, Finding(float(value), known.sd, model))
        if line is not None:
            found.append(replace(line, constant=name))
    return sorted(found, key=lambda line: not line.determined)


def health_lines(model: Model) -> list[str]:
    """The lines in words, and what these clips do not determine; for the terminal and result.json."""
    if model.fitted and not model.fitted.get("converged", False):
        return [NOT_CONVERGED_LINE]
    lines = health(model)
    undetermined = [line.what for line in lines if not line.determined]
    return [line.text() for line in lines if line.determined] + (
        [f"{NOT_DETERMINED}: {', '.join(undetermined)}"] if undetermined else []
    )


def print_health(model: Model) -> None:
    """The block at the end of `fit` and `discover`."""
    if lines := health_lines(model):
        print("\nThe table's health\n" + "\n".join(f"  {line}" for line in lines))
