"""A segment's residuals do not depend on what stands beside it, and its ball is played to its last sample."""

from __future__ import annotations

import numpy as np

from models.model_file import full_model
from models.shot import Ball, Table
from sysid.clips.segments import Segment
from sysid.estimation.problem import values_of
from sysid.estimation.residual_rows import stamps_until
from sysid.estimation.segment_problem import segment_problem
from sysid.selection.formulas.terms import effect_from_terms, library

BALL, TABLE = Ball(0.0525, 0.1406), Table(3.569, 1.778, pockets=False)


def segment(seconds: float) -> Segment:
    time = np.arange(0.0, seconds, 0.02)
    xy = np.column_stack([-1.0 + 1.2 * time, 0.4 * time])
    return Segment(0, "white", time, xy, "start", "end")


def test_residuals_do_not_depend_on_longer_segments_beside() -> None:
    terms = [t for t in library(TABLE) if t.name in {"push_y_xy", "push_x_x"}]
    model = full_model(TABLE, BALL).add(effect_from_terms("formula", terms, [0.05] * len(terms)))
    short, long = segment(0.8), segment(1.6)
    both, alone = (segment_problem(model, (), part, 4e-4) for part in ([short, long], [short]))
    c, row = values_of(model, ())[None], np.zeros(1, np.int64)
    expected = alone.evaluate(alone.start, c, row)
    found = both.evaluate(both.start[:1], c, row)
    assert np.isfinite(expected).all()
    np.testing.assert_array_equal(found[:, : expected.shape[1]], expected)


def test_stamps_that_pad_a_shot_are_never_played_to() -> None:
    stamps = np.array([0.1, 0.2, 0.3, np.inf, np.inf])
    assert [stamps_until(stamps, horizon) for horizon in (0.0, 0.2, 1.0, np.inf)] == [0, 2, 3, 3]
