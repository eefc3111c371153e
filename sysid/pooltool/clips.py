"""Conversion of pooltool's systems to a clip set: each simulated system becomes a clip.

In: files that `System.save` or `MultiSystem.save` wrote. Out: `Imported`.

A continuous system (`pt.continuize`) has states at even times, which are the samples. Any other has states at events
alone; between them positions follow, at an even rate, from pooltool's closed forms of sliding and rolling with the
system's constants. A track ends where the ball falls. The command is that of the system's cue, its speed that with
which the ball leaves it. Events and constants are left out, since a clip set does not hold them.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from models.analytic.cloth import state_at
from models.errors import BadInput
from models.files.documents import entries_of
from models.files.faults import listed
from models.files.limits import MAX_BALLS, excess
from models.messages import MessageParts
from models.shot import GRAVITY, Array, Ball, Table
from sysid.clips.clip_set import Clip, ClipSet, CueCommand, Observation
from sysid.clips.running import begun, usual_noise
from sysid.foreign.convert import Imported
from sysid.pooltool.document import SYSTEM_REMEDY, read_systems
from sysid.pooltool.frame import PHI_AHEAD_RAD, TableFrame
from sysid.pooltool.table import table_here

EVENT_FPS = 120.0  # default rate of samples between events [1/s]
POCKETED_STATE = 4  # pooltool's motion state of a pocketed ball
MIN_SPEED = 1e-3  # least speed of a ball that moves at the start [m/s]
SIMULATE_REMEDY = "simulate it with pt.simulate(system, continuous=True), and save it again"
Data = Mapping[str, Any]


def import_pooltool(
    files: Sequence[Path], *, table: Table | None = None, ball: Ball | None = None, fps: float | None = None
) -> Imported:
    """Convert simulated systems.

    Args:
        files: .json or .msgpack.
        table: instead of that of the first system.
        ball: instead of that of the first system.
        fps: rate of samples between events; states at even times have their own rate.

    Raises:
        BadInput: for a file without a system, a system that was not simulated, and systems of several tables.
    """
    systems = [(path, one) for path in files for one in read_systems(path)]
    counts = [sum(path == other for other, _ in systems) for path, _ in systems]
    clips, own, rates = list[Clip](), list[tuple[Table, Ball]](), list[float]()
    numbers = {path: itertools.count(1) for path in files}
    notes = list[str]()
    for (path, one), count in zip(systems, counts, strict=True):
        name = f"{path.stem}_{next(numbers[path]):04d}" if count > 1 else path.stem
        with entries_of(path, SYSTEM_REMEDY):
            sizes, clip, rate, note = _clip(one, path, f"clips/{name}.csv", fps)
        clips, own, rates = [*clips, clip], [*own, sizes], [*rates, rate]
        notes += [note] if note and note not in notes else []
    if any(sizes != own[0] for sizes in own[1:]):
        raise BadInput(f"{files[0]} and others: the systems differ in table or balls: import them one table at a time")
    table, ball = table or own[0][0], ball or own[0][1]
    rate = float(f"{np.median(rates):.6g}")
    clip_set = ClipSet(table, ball, rate, tuple(clips))
    sigma = usual_noise(clip_set) if any(clip.running for clip in clips) else 0.0
    free = [begun(clip, clip_set, sigma) if clip.running else clip for clip in clips]
    clip_set = dataclasses.replace(clip_set, clips=tuple(clip for clip in free if clip is not None))
    says = (
        f"systems of pooltool: {len(clips)}, on {table.length:.4f} x {table.width:.4f} m between our noses, "
        f"balls of {1e3 * ball.diameter:g} mm",
        f"samples: {clip_set.fps:g} a second", *notes,
    )  # fmt: skip
    assumed = (MessageParts(("laws and constants of the systems are left out: clips hold positions only",)),)
    return Imported(clip_set, says, assumed)


def _clip(data: Data, path: Path, file: str, fps: float | None) -> tuple[tuple[Table, Ball], Clip, float, str]:
    """Table, ball and clip of a system, the rate of its samples [1/s], and a remark on its table or samples."""
    balls: Mapping[str, Data] = data["balls"]
    if problem := excess(len(balls), MAX_BALLS, "balls", "remove some"):
        raise BadInput(f"{path}: {problem}")
    sizes = {(2 * float(one["params"]["R"]), float(one["params"]["m"])) for one in balls.values()}
    if len({diameter for diameter, _ in sizes}) != 1:
        raise BadInput(f"{path}: balls of several sizes: a clip set has balls of one")
    struck = str(data["cue"]["cue_ball_id"])
    if struck not in balls:
        raise BadInput(f"{path}: its cue strikes {struck!r}, but it has {listed(list(balls))}")
    ball = Ball(2 * float(balls[struck]["params"]["R"]), float(balls[struck]["params"]["m"]))
    table, frame, remark = table_here(data["table"], ball)
    states = {name: _states(one["history"]) for name, one in balls.items()}
    if any(one is None or len(one[0]) < 2 for one in states.values()):
        raise BadInput(f"{path}: a system that was not simulated: {SIMULATE_REMEDY}")
    events = {name: one for name, one in states.items() if one is not None}
    even = {name: one for name, ball_ in balls.items() if (one := _states(ball_["history_cts"])) is not None}
    if len(even) == len(balls):
        steps = np.diff(even[struck][0])
        rate = float(1 / np.median(steps)) if len(steps) else 0.0
        # The last state is that of the last event, not at an even time.
        tracks = {name: (t[:-1], rvw[:-1, 0, :2], s[:-1]) for name, (t, rvw, s) in even.items()}
    else:
        rate = fps or EVENT_FPS
        times = np.arange(0.0, events[struck][0][-1], 1 / rate)
        tracks = {name: _between(times, *one, balls[name]["params"]) for name, one in events.items()}
        remark = remark or "states at events alone: samples between them by the systems' own cloth"
    seen = {name: _observation(frame, *one) for name, one in tracks.items()}
    if len(seen[struck].time) < 3:
        raise BadInput(f"{path}: {struck!r} has fewer than three samples: {SIMULATE_REMEDY}")
    moving = _moving(events)
    command = _command(data["cue"], ball, events[struck][1], moving)
    if command is None and len(moving) != 1:
        running = tuple(sorted(moving, key=lambda name: -moving[name]))
        if not running:
            raise BadInput(f"{path}: no ball moves: {SIMULATE_REMEDY}")
        return (table, ball), Clip(file, running[0], seen, running=running), rate, remark
    return (table, ball), Clip(file, struck if command else next(iter(moving)), seen, command), rate, remark


def _states(history: Any) -> tuple[Array, Array, Array] | None:
    """Times (n,), states (n, 3, 3) and kinds of motion (n,) of a history; None for an empty one."""
    if history is None or (isinstance(history, dict) and not history["states"]):
        return None
    if isinstance(history, dict):
        rows = history["states"]
        rvw, s, t = ([one[key] for one in rows] for key in ("rvw", "s", "t"))
    else:
        rvw, s, t = history
    times, states = np.asarray(t, float), np.asarray(rvw, float)
    if states.shape != (len(times), 3, 3) or not (np.isfinite(states).all() and np.isfinite(times).all()):
        raise ValueError("a history that is not of finite states of 3 x 3 numbers")
    if (np.diff(times) < 0).any():
        raise ValueError("a history that goes back in time")
    return times, states, np.asarray(s, float)


def _between(times: Array, t: Array, rvw: Array, s: Array, params: Data) -> tuple[Array, Array, Array]:
    """Positions (n, 2) [m] and kinds of motion at times (n,), from the states at events by pooltool's cloth."""
    last = np.searchsorted(t, times, side="right") - 1
    gravity, radius = float(params["g"]), float(params["R"])
    alpha = 2.5 * float(params["u_sp_proportionality"]) * gravity
    xy, _, _ = state_at(
        times - t[last], rvw[last, 0, :2], rvw[last, 1, :2], rvw[last, 2], radius,
        float(params["u_s"]) * gravity / GRAVITY, float(params["u_r"]) * gravity / GRAVITY, alpha,
    )  # fmt: skip
    return times, xy, s[last]


def _observation(frame: TableFrame, times: Array, xy: Array, s: Array) -> Observation:
    """A ball's track in our frame, until it falls."""
    fallen = np.flatnonzero(s == POCKETED_STATE)
    end = int(fallen[0]) if fallen.size else len(times)
    return Observation(times[:end], frame.place_here(xy[:end]), np.full(end, math.nan))


def _moving(events: Mapping[str, tuple[Array, Array, Array]]) -> dict[str, float]:
    """Speeds of the balls that move just after the start, including a struck ball [m/s]."""
    found = {}
    for name, (t, rvw, _) in events.items():
        speed = float(np.hypot(*rvw[np.flatnonzero(t <= t[0])[-1], 1, :2]))
        if speed > MIN_SPEED:
            found[name] = speed
    return found


def _command(cue: Data, ball: Ball, states: Array, moving: Mapping[str, float]) -> CueCommand | None:
    """The command of the cue; None if it struck no ball because one was already moving."""
    struck = str(cue["cue_ball_id"])
    if struck not in moving or len(moving) > 1 or np.hypot(*states[0, 1, :2]) > MIN_SPEED:
        return None
    azimuth = math.remainder(math.radians(float(cue["phi"])) - PHI_AHEAD_RAD, 2 * math.pi)
    side, height = -float(cue["a"]) * ball.radius, float(cue["b"]) * ball.radius
    return CueCommand(moving[struck], azimuth, side, height, math.radians(float(cue["theta"])))
