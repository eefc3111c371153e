"""Clip sets of the independent generator: the constants they hide, and how far a fit is from them."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

from models.table.sizes import BALL_DIAMETER, TABLE_LENGTH, TABLE_WIDTH
from sysid.clips import Clip, ClipSet, read_clip_set
from sysid.estimation import ClipFit
from tests.bench.accuracy import CONSTANTS
from tests.truth.__main__ import main as make_truth
from tests.truth.physics import Table as TruthTable

KINDS = "stun,draw,side,spin,swerve,cushion,cushion_side,cut,cut_side"
Truth = dict[str, float]
Case = tuple[ClipSet, Truth]


def make(folder: Path, seed: int, *more: str, kinds: str = KINDS) -> Case:
    """Twelve clips of 1.5 seconds by the independent generator, and the constants they hide."""
    options = ["--seed", str(seed), "--clips", "12", "--seconds", "1.5", "--kind", kinds, *more]
    assert make_truth([str(folder), *options]) == 0
    return read_clip_set(folder), truth_of(folder)


def truth_of(folder: Path) -> Truth:
    """The constants beside a clip set, by the names that a model gives them."""
    truth = json.loads(folder.with_name(folder.name + ".truth.json").read_text())["parameters"]
    sizes = {TABLE_LENGTH: TruthTable.length, TABLE_WIDTH: TruthTable.width, BALL_DIAMETER: 2 * truth["R"]}
    return {name: truth[short] for name, short in CONSTANTS.items()} | sizes


def miss(found: ClipFit, truth: Truth) -> dict[str, float]:
    """How far each constant lies from the truth, in its own standard deviations."""
    values = found.model.parameters()
    return {n: float((values[n] - truth[n]) / sd) for n, sd in found.fitted.sds.items()}


def changed(clip_set: ClipSet, edit: Any) -> ClipSet:
    """The set with every ball's track edited."""
    clips: list[Clip] = []
    for clip in clip_set.clips:
        balls = {name: edit(seen) for name, seen in clip.balls.items()}
        clips.append(dataclasses.replace(clip, balls=balls))
    return dataclasses.replace(clip_set, clips=tuple(clips))
