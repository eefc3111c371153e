"""A clip set, split into training clips and every fifth held out, and fits evaluated on both.

In: a clip set and a model. Out: a `Split`, the open cloth's constants, and fits with their error on held-out clips.

Shots that a model does not follow from any start are excluded by name, so that they do not bias the constants. A shot
is lost if its residuals are not finite, or if it ends far from where it was seen and much farther than the others: the
track is not a shot on this table, the clip holds two shots, or another ball was struck. An effect that the model lacks
leaves errors of millimetres to centimetres, in many shots.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.errors import BadInput
from models.model_file import Model
from sysid.clips import ClipSet
from sysid.clips.tracker.clock import stamp_scale
from sysid.clips.tracker.noise import noise_correlation, position_noise
from sysid.clips.tracker.outliers import remove_outliers
from sysid.clips.tracker.slow_noise import slow_noise
from sysid.estimation.fitted import UNFOLLOWED_RATE, FittedModel, Point
from sysid.estimation.fitting import fit, fit_held_out
from sysid.estimation.open_cloth import OpenCloth, fit_open_cloth
from sysid.estimation.problem import Array, Index
from sysid.estimation.shot_problem import ShotProblem, shot_problem
from sysid.estimation.sizes import known_sizes, with_free_sizes

HELD_OUT_EVERY = 5  # clips, of which the last is held out
CLOCK_CONSTANT = "clock_scale.factor"  # its prior is known from the time stamps of the clips
LOST_M = 0.3  # rms residual per axis from which a shot may be lost
LOST_RATIO = 20.0  # and its ratio to the median of all shots
log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Split:
    """The shots of a clip set, for training and held out."""

    training: ShotProblem
    held_out: ShotProblem | None
    spikes: int  # samples left out as outliers
    excluded: tuple[str, ...] = ()  # shots that were excluded, a line each
    exchanged: tuple[tuple[str, str], ...] = ()  # shots that were held out, and those that are in place of them

    @property
    def noise(self) -> float:
        """Noise of the camera, one standard deviation per axis [m]."""
        return self.training.noise

    def follows(self, found: FittedModel) -> bool:
        """Whether whole shots are followed closely enough to determine forces between impacts."""
        return found.discrepancy_rate <= UNFOLLOWED_RATE

    def excluding(self, lines: tuple[str, ...], training: ShotProblem, held_out: ShotProblem | None) -> Split:
        """The split with only those shots; the others are excluded with a line each."""
        for line in lines:
            log.info("%s", line)
        return dataclasses.replace(self, training=training, held_out=held_out, excluded=(*self.excluded, *lines))

    def states_of(self, found: FittedModel, files: Sequence[str]) -> Array | None:
        """Initial states of all clips, in the order of `files`: (n, p); None if some were not fitted."""
        if self.excluded:
            return None
        parts = [(self.training, found.initial_states)]
        if self.held_out and found.held_out:
            parts.append((self.held_out, found.held_out.initial_states))
        resting = max(part.motions_from for part, _ in parts)
        moving = max(x.shape[1] - part.motions_from for part, x in parts)
        known: dict[str, Array] = {}
        for part, x in parts:  # clips of fewer balls have fewer unknowns
            still, motions = x[:, : part.motions_from], x[:, part.motions_from :]
            rows = np.concatenate([
                np.pad(still, ((0, 0), (0, resting - still.shape[1]))),
                np.pad(motions, ((0, 0), (0, moving - motions.shape[1]))),
            ], axis=1)  # fmt: skip
            known |= {c.file: row for c, row in zip(part.clips, rows, strict=True)}
        return np.array([known[f] for f in files])


def training_clips(clip_set: ClipSet) -> list[int]:
    """Clips for training: all but every fifth."""
    n, every = len(clip_set.clips), HELD_OUT_EVERY
    return [k for k in range(n) if n < every or k % every != every - 1]


def subset(clip_set: ClipSet, rows: Sequence[int]) -> ClipSet:
    """Some clips of a set."""
    return dataclasses.replace(clip_set, clips=tuple(clip_set.clips[k] for k in rows))


def split(clip_set: ClipSet, model: Model) -> tuple[Split, OpenCloth, Model]:
    """Split the clips, fit the open cloth's constants to segments, and give the model these constants."""
    noise = position_noise(clip_set)
    clip_set, spikes = remove_outliers(clip_set, noise)
    slow = slow_noise(clip_set, noise)
    correlation = slow.together(noise, noise_correlation(clip_set))
    if slow.sd:
        log.info("%s; fits add it to the noise", slow.in_words())
    scale, sd = stamp_scale(clip_set)
    known = {CLOCK_CONSTANT: (scale, sd)} if np.isfinite(sd) else {}
    rows = training_clips(clip_set)
    training, held = subset(clip_set, rows), subset(clip_set, [k for k in range(len(clip_set.clips)) if k not in rows])
    cloth = fit_open_cloth(model, training, noise)
    model = model.with_values(cloth.known)

    def problem_of(part: ClipSet) -> ShotProblem:
        return shot_problem(model, tuple(model.parameters()), part, noise, known, correlation, slow.sd)

    model = with_free_sizes(model)
    known |= known_sizes(model)
    return Split(problem_of(training), problem_of(held) if held.clips else None, spikes), cloth, model


def shot_errors(problem: ShotProblem, x: Array, c: Array) -> Array:
    """Rms residual of every shot per axis at initial states (n, p) and constants (q,): (n,) [m]."""
    r = problem.evaluate(x, np.tile(c, (len(x), 1)), np.arange(len(x)))
    count = np.maximum(np.isfinite(r).sum(axis=1), 1)
    return np.asarray(problem.noise * np.sqrt(np.nansum(r**2, axis=1) / count))


def lost_shots(errors: Array, typical: float) -> Index:
    """Shots that are lost, from their errors (n,) [m] and the median error of the training shots [m]."""
    return np.flatnonzero(~(errors <= max(LOST_M, LOST_RATIO * typical)))


def typical_error(errors: Array) -> float:
    """Median error of shots (n,) [m].

    Raises:
        BadInput: where most shots are lost, so that no constant means anything.
    """
    typical = float(np.median(errors))
    if not typical <= LOST_M:
        raise BadInput(
            f"most shots end {typical:.2g} m from where they were seen, from every start and spin tried; "
            "check the table's size, the units, and which ball is struck"
        )
    return typical


def exclusion_lines(problem: ShotProblem, rows: Index, errors: Array) -> tuple[str, ...]:
    """One line for each excluded shot."""
    return tuple(
        f"{problem.clips[k].file}: excluded, since it ends {errors[k]:.2g} m away from every start and spin tried"
        for k in rows.tolist()
    )


def fit_on(parts: Split, start: Point, before: FittedModel, what: str, searching: bool = True) -> FittedModel:
    """A fit from a start (see `fit`), evaluated on the held-out clips, with their nearly right states `before`."""
    found = fit(start, what, searching)
    if parts.held_out is None or before.held_out is None:
        return found
    held = fit_held_out(found, parts.held_out, before.held_out.initial_states, searching)
    return dataclasses.replace(found, held_out=held)
