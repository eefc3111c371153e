"""Shots played in plain MJCF by MuJoCo alone, at the file's own time step.

In: models, whose native terms may differ from shot to shot. Out: `Track`s without events.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import mujoco
import mujoco.batch
import numpy as np

from models.mjcf.native import Native
from models.model_file import Model
from models.shot import Array, Shot, Track
from sysid.mjcf.said import plain_spec


def play_plain(model: Model, shots: Sequence[Shot], rail_terms: Mapping[str, Native] | None = None) -> list[Track]:
    """The tracks of shots of the same balls and times, on the file of a model.

    Native terms are numbers, or (len(shots),) arrays; a file does not contain the cue's action on a ball.
    """
    terms = np.column_stack([np.broadcast_to(getattr(model.native, k), len(shots)) for k in Native.parameters()])
    tracks: list[Track | None] = [None] * len(shots)
    for row in np.unique(terms, axis=0):
        native = Native(**dict(zip(Native.parameters(), row.tolist(), strict=True)))
        which = np.flatnonzero((terms == row).all(axis=1))
        own = model.with_values({f"native.{k}": getattr(native, k) for k in Native.parameters()})
        for k, track in zip(which, _play(own, [shots[int(i)] for i in which], rail_terms), strict=True):
            tracks[k] = track
    return [track for track in tracks if track is not None]


def _play(model: Model, shots: Sequence[Shot], rail_terms: Mapping[str, Native] | None) -> list[Track]:
    names, count, times = shots[0].names, len(shots), np.asarray(shots[0].times)
    places = {name: np.array([2 * model.ball.diameter * k, 0.0]) for k, name in enumerate(names)}
    compiled = plain_spec(model, places, rail_terms, bare=True).compile()
    batch = mujoco.batch.Batch(compiled, count)
    qpos = batch.bind("qpos").reshape(count, len(names), 7)
    qvel = batch.bind("qvel").reshape(count, len(names), 6)
    qpos[..., :2], qvel[..., :2] = [s.position for s in shots], [s.velocity for s in shots]
    qvel[..., 3:] = [s.spin for s in shots]  # in the ball's frame, which is initially the table's
    state = np.empty((count, len(times), len(names), 7))
    done = 0
    for k, now in enumerate(np.round(times / compiled.opt.timestep).astype(int).tolist()):
        if now > done:
            batch.step(nstep=now - done)
            done = now
        state[:, k, :, :2], state[:, k, :, 2:4] = qpos[..., :2], qvel[..., :2]
        state[:, k, :, 4:] = _turned(qpos[..., 3:], qvel[..., 3:])
    theta = np.full(state.shape[1:3], np.nan)
    return [
        Track(s.names, s.times, x[..., :2], x[..., 2:4], x[..., 4:], theta) for s, x in zip(shots, state, strict=True)
    ]


def _turned(quaternion: Array, vector: Array) -> Array:
    """Vectors (..., 3) turned by quaternions (..., 4)."""
    w, axis = quaternion[..., :1], quaternion[..., 1:]
    across = 2.0 * np.cross(axis, vector)
    return np.asarray(vector + w * across + np.cross(axis, across))
