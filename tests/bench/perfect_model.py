"""The error that a perfect model would leave: what noise and chaos alone cost on a match.

    python -m tests.bench.perfect_model CLIPS MODEL.toml [SEEDS]

Every held-out shot is fitted, played again by the model from its fitted initial state, filmed with the camera's noise
by a tracker that leaves out balls until they have moved 14 mm, and fitted as `sysid compare` does. Prints the struck
ball's rms over whole shots, median and quartiles: of the match, and of its copies, of which the model is exactly right.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from models.model_file import Model, read_model
from models.shot import Track
from models.simulation.simulate import simulate
from sysid.clips import ClipSet, Observation, read_clip_set
from sysid.clips.tracker.noise import position_noise
from sysid.clips.tracker.outliers import remove_outliers
from sysid.estimation.chains.chain_search import found_states
from sysid.estimation.shot_problem import ShotProblem, residual, shot_problem
from sysid.estimation.split import subset, training_clips
from sysid.estimation.states.initial_states import polished

Array = NDArray[np.float64]
NO_CONSTANTS = np.zeros(0)
MIN_MOVE_M = 0.014  # from sample to sample, of the tracker
DEFAULT_SEEDS = 3


def errors_of(problem: ShotProblem) -> tuple[Array, Array]:
    """Initial states (n, p) of whole shots, and the struck ball's rms distance (n,) [m]."""
    x, n = polished(problem, found_states(problem, NO_CONSTANTS), NO_CONSTANTS), len(problem.clips)
    found = []
    for track, clip in zip(problem.tracks(x, np.zeros((n, 0)), np.arange(n)), problem.clips, strict=True):
        seen = clip.balls[clip.struck]
        error, _ = residual(track, 0, seen, len(seen.time))
        found.append(float(np.sqrt(np.mean(np.sum(error**2, axis=1)))))
    return x, np.array(found)


def filmed(track: Track, noise: float, rng: np.random.Generator) -> dict[str, Observation]:
    """What the tracker writes of a shot: balls that have moved, the first and the last sample."""
    balls = {}
    for b, name in enumerate(track.names):
        xy, kept = track.position[:, b], [0]
        for k in range(1, len(xy)):
            if k == len(xy) - 1 or np.hypot(*(xy[k] - xy[kept[-1]])) > MIN_MOVE_M:
                kept.append(k)
        seen = xy[kept] + noise * rng.standard_normal((len(kept), 2))
        balls[name] = Observation(track.times[kept], seen, np.full(len(kept), np.nan))
    return balls


def copied(problem: ShotProblem, x: Array, rng: np.random.Generator) -> ShotProblem:
    """The same shots, played by the model from their initial states (n, p) and filmed."""
    times = [np.arange(0.0, end + 1e-9, 1 / problem.clip_set.fps) for end in problem.end]
    tracks = simulate(problem.model, [problem.shot(row, k, t) for k, (row, t) in enumerate(zip(x, times, strict=True))])
    clips = []
    for clip, track in zip(problem.clips, tracks, strict=True):
        balls = filmed(track, problem.noise, rng)
        clips.append(replace(clip, balls={name: balls[name] for name in clip.balls}))
    return shot_problem(problem.model, (), replace(problem.clip_set, clips=tuple(clips)), problem.noise)


def held_out(clip_set: ClipSet, model: Model) -> ShotProblem:
    """The clips that are held out of every fit."""
    noise = position_noise(clip_set)
    clip_set, _ = remove_outliers(clip_set, noise)
    rows = sorted(set(range(len(clip_set.clips))) - set(training_clips(clip_set)))
    return shot_problem(model, (), subset(clip_set, rows), noise)


def told(what: str, errors: Array) -> str:
    """Median and quartiles of errors (n,) [m] in words."""
    low, middle, high = np.percentile(errors, [25, 50, 75]) * 1e3
    return f"{what:<24} median {middle:6.2f} mm, quartiles {low:.2f} and {high:.2f} mm, {len(errors)} shots"


def main(clips: str, model: str, seeds: str = str(DEFAULT_SEEDS)) -> None:
    """Print the figures."""
    problem = held_out(read_clip_set(Path(clips)), read_model(Path(model)))
    x, errors = errors_of(problem)
    print(told("the match", errors), flush=True)
    for seed in range(int(seeds)):
        _, errors = errors_of(copied(problem, x, np.random.default_rng(seed)))
        print(told(f"a perfect model, seed {seed}", errors), flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
