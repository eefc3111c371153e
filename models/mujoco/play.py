"""Many shots to many tracks, moved by MuJoCo: one `World` for each number of balls and size, on `mujoco.batch`.

Shots of one world are stepped side by side, each with its own row of parameters, steps and memory; the callback writes
down what is sampled (models/mujoco/record.py).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final

import mujoco
import mujoco.batch
import numpy as np

from models.analytic.pocket import rail_of
from models.effect import STILL
from models.engine import columns as col
from models.engine import touch
from models.engine.impacts import strike_rows
from models.engine.play import EVENT_KINDS
from models.mujoco import memory as mem
from models.mujoco.world import World
from models.shot import Array, Event, Shot, Track

if TYPE_CHECKING:
    from models.model_file import Model

CHUNK_SIZE: Final = 512  # simulations at a time
MANY_BALLS: Final = 8
STEPS_AT_A_TIME: Final = 64  # between two looks at which of them go on
MAX_STEPS: Final = 5_000_000  # of a shot, after which it is given up
LOOKS_AT_REST: Final = 2  # after which nothing more is expected of it
EVENT_ROOM: Final = 256  # events of a shot to begin with
BATCH_FIELDS: Final = (
    "pair_friction",
    "pair_solref",
    "pair_solreffriction",
    "opt.gravity",
    "body_mass",
    "body_inertia",
)


def play(
    model: Model, shots: Sequence[Shot], *, threads: int = 0, jaws: bool = False,
    progress: Callable[[int], None] | None = None,
) -> list[Track]:  # fmt: skip
    """A track for every shot, in order; parameters of the model are numbers or (len(shots),) arrays.

    Args:
        model: table, ball and effects; what no effect takes over has MuJoCo's own contacts.
        shots: the balls' states at t = 0, and the times wanted.
        threads: that step the simulations; 0 for one a core. Tracks do not depend on it.
        jaws: whether pockets have jaws and an edge.
        progress: called with the number of shots done.

    Raises:
        RuntimeError: for a shot that does not come to its end, or that MuJoCo cannot step.
    """
    tracks: list[Track | None] = [None] * len(shots)
    sizes = [np.broadcast_to(np.asarray(v, float), (len(shots),)) for v in model.sizes.values()]
    worlds = np.column_stack([np.array([len(s.names) for s in shots], float), *sizes])
    done = 0
    for world in np.unique(worlds, axis=0):
        rows = np.flatnonzero((worlds == world).all(axis=1))
        own = model.with_values(dict(zip(model.sizes, world[1:].tolist(), strict=True))).as_played()
        for start in range(0, rows.size, CHUNK_SIZE):
            part = rows[start : start + CHUNK_SIZE]
            for k, track in zip(
                part, _play(own.select(part), [shots[int(r)] for r in part], threads, jaws), strict=True
            ):
                tracks[k] = track
            done += part.size
            if progress:
                progress(done)
    return [t for t in tracks if t is not None]


def _play(model: Model, shots: Sequence[Shot], threads: int, jaws: bool) -> list[Track]:
    """Shots of one number of balls, on tables of one size."""
    count, names = len(shots), [f"ball {i}" for i in range(len(shots[0].names))]
    world = World(model, names, rows=count, jaws=jaws)
    try:
        return _played(world, model, shots, threads, jaws)
    finally:
        world.forget()


def _played(world: World, model: Model, shots: Sequence[Shot], threads: int, jaws: bool) -> list[Track]:
    count, names = len(shots), world.names
    sleeps = len(names) >= MANY_BALLS  # most of which lie still, and cost nothing then
    if sleeps:
        world.mj_model.opt.enableflags |= mujoco.mjtEnableBit.mjENBL_SLEEP
    batch = mujoco.batch.Batch(world.mj_model, count, nthread=threads, persistent=sleeps)
    batch.expand("opt.timestep")
    _vary(batch, model, names, count, jaws)
    _weigh(batch, world)
    n = len(names)
    qpos, qvel = batch.bind("qpos").reshape(count, n, 7), batch.bind("qvel").reshape(count, n, 6)
    kept = batch.bind("userdata")
    velocity, spin = np.array([s.velocity for s in shots], float), np.array([s.spin for s in shots], float)
    struck = np.array([s.struck for s in shots])
    hooks, ball = world.hooks, world.model.ball
    strike_rows(np.ascontiguousarray(hooks.own), hooks.strike, ball.radius, ball.mass, struck, velocity, spin)
    start = np.zeros((count, n, 13))
    start[..., :2], start[..., 2], start[..., 3] = [s.position for s in shots], ball.radius, 1.0
    start[..., 7:9], start[..., 10:] = velocity, spin
    launch = np.hypot(velocity[:, 0, 0], velocity[:, 0, 1]) * struck
    room = EVENT_ROOM
    while True:
        records = [_record(shot.times, n, room) for shot in shots]
        qpos[:], qvel[:] = start[..., :7], start[..., 7:]
        batch.bind("time")[:] = 0.0
        for k, shot in enumerate(shots):
            kept[k] = mem.at_strike(k, 0.0, float(launch[k]), shot.session, kept.shape[1])
            kept[k, mem.RECORD] = float(records[k].ctypes.data)
            balls = kept[k, mem.HEAD_SIZE : mem.HEAD_SIZE + n * mem.BALL_MEMORY].reshape(n, mem.BALL_MEMORY)
            balls[:, mem.STAYS] = [name in shot.staying for name in shot.names]
        _step(batch, records, qpos, qvel, kept)
        most = max((int(r[mem.EVENT_COUNT]) for r in records), default=0)
        if most <= room:
            return [_track(shot, record, n, room) for shot, record in zip(shots, records, strict=True)]
        room = most


def _record(times: Array, balls: int, events: int) -> Array:
    record = np.full(mem.record_size(len(times), balls, events), np.nan)
    record[[mem.TIME_COUNT, mem.NEXT_TIME, mem.EVENT_ROOM, mem.EVENT_COUNT]] = len(times), 0, events, 0
    record[mem.RECORD_HEAD : mem.RECORD_HEAD + len(times)] = times
    return record


def _step(batch: Any, records: Sequence[Array], qpos: Array, qvel: Array, kept: Array) -> None:
    """Step all until each has its last sample, or until nothing in it has moved for a while."""
    going, taken = np.array([k for k, r in enumerate(records) if r[mem.TIME_COUNT] > 0], np.int64), 0
    rested = np.zeros(len(records), np.int64)
    while going.size:
        batch.step(ids=going, nstep=STEPS_AT_A_TIME)
        taken += STEPS_AT_A_TIME
        in_play = qpos[going, :, 2:3] > 0
        still = (np.where(in_play, np.abs(qvel[going]), 0.0) < STILL).all(axis=(1, 2))
        rested[going] = np.where(still, rested[going] + 1, 0)
        for k in going[rested[going] >= LOOKS_AT_REST]:
            _fill(records[k], qpos[k])
        going = np.array([k for k in going if records[k][mem.NEXT_TIME] < records[k][mem.TIME_COUNT]], np.int64)
        if (lost := going[kept[going, mem.RECORD] == 0.0]).size:  # MuJoCo has reset it
            raise RuntimeError(f"shot {lost[0]} became unstable in MuJoCo; use values nearer to the usual ones")
        if going.size and taken > MAX_STEPS:
            raise RuntimeError(f"shot {going[0]} has not come to its end after {taken} steps")


def _fill(record: Array, qpos: Array) -> None:
    """Record balls at rest in their places at all remaining times."""
    count, done = int(record[mem.TIME_COUNT]), int(record[mem.NEXT_TIME])
    samples = record[mem.RECORD_HEAD + count :][: count * len(qpos) * col.ROW_SIZE].reshape(count, -1, col.ROW_SIZE)
    samples[done:, :, :2], samples[done:, :, 2:7] = qpos[:, :2], 0.0
    samples[done:, :, 7] = samples[done - 1, :, 7] if done else 0.0
    samples[done:, qpos[:, 2] < 0] = np.nan
    record[mem.NEXT_TIME] = count


def _track(shot: Shot, record: Array, n: int, room: int) -> Track:
    count = len(shot.times)
    begin = mem.RECORD_HEAD + count
    end = begin + count * n * col.ROW_SIZE
    data = record[begin:end].reshape(count, n, col.ROW_SIZE).copy()
    happened = []
    for when, kind, i, other, x, y in (
        record[end:].reshape(room, mem.EVENT_SIZE)[: int(record[mem.EVENT_COUNT])].tolist()
    ):
        if when > shot.times[-1]:
            break
        first, name = shot.names[int(i)], EVENT_KINDS[int(kind)]
        if kind == touch.BALL:
            happened.append(Event(when, name, (first, shot.names[int(other)]), "", None))
        elif kind == touch.CUSHION:
            happened.append(Event(when, name, (first,), rail_of(int(other)), None))
        else:
            happened.append(Event(when, name, (first,), "", (x, y)))
    return Track(
        shot.names, shot.times, data[..., :2], data[..., 2:4], data[..., 4:7], data[..., 7], tuple(happened)
    )  # fmt: skip


def _weigh(batch: Any, world: World) -> None:
    """Give each simulation the masses of its own balls, where they differ."""
    if (world.masses == world.masses[0]).all():
        return
    bodies = [world.mj_model.body(name).id for name in world.names]
    batch.expand("body_mass")[:, bodies] = world.masses
    batch.expand("body_inertia")[:, bodies] = (0.4 * world.model.ball.radius**2 * world.masses)[:, :, None]
    batch.set_const()


def _vary(batch: Any, model: Model, names: Sequence[str], count: int, jaws: bool) -> None:
    """Copy in what effects that edit the MJCF make of each simulation, where they differ from each other."""
    editors = [e for e in model.stack() if e.opens("edit")]
    if not any(np.ndim(getattr(e, key)) for e in editors for key in e.parameters()):
        return
    own = np.column_stack([np.broadcast_to(getattr(e, key), count) for e in editors for key in e.parameters()])
    fields = {name: batch.expand(name) for name in BATCH_FIELDS}
    for row in np.unique(own, axis=0):
        same = np.flatnonzero((own == row).all(axis=1))
        variant = World(model.select(same[:1]), names, jaws=jaws)
        for name, values in fields.items():
            source = variant.mj_model.opt.gravity if name == "opt.gravity" else getattr(variant.mj_model, name)
            values[same] = np.reshape(source, values[0].shape)
        variant.forget()
