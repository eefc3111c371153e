"""Many shots -> many tracks: by the event engine (models/engine), or moved by MuJoCo (models/mujoco)."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from models.engine.play import lacking, play
from models.model_file import Model
from models.shot import Shot, Track

CHUNK_SIZE = 1024  # number of simulations at a time
CONTACT_MODES = ("clusters", "never")


def _check(model: Model, shots: Sequence[Shot], jaws: bool) -> None:
    """Raise ValueError, which names the offender, for shots and parameters that do not fit together."""
    if jaws:
        found = {e.resolves for e in model.stack()} | {e.slot for e in model.stack()}
        missing = [k for k in ("cloth", "ball", "cushion") if k not in found]
        if missing:
            raise ValueError(
                f"jaws need effects that take over cloth, balls and cushions; this model has none for "
                f"{', '.join(missing)}: add decoupled_cloth, ball_impact, cushion_impact"
            )
    own = {f"{e.name()}.{key}": getattr(e, key) for e in model.stack() for key in e.parameters()}
    for name, value in (own | dict(model.sizes)).items():
        shape = np.shape(value)
        if shape not in ((), (len(shots),)):
            raise ValueError(f"{name} has shape {shape}; give one number, or one for each of {len(shots)} shots")
    for k, shot in enumerate(shots):
        n, times = len(shot.names), np.asarray(shot.times, float)
        if n == 0:
            raise ValueError(f"shot {k} has no balls; name at least one")
        for name, shape in (("position", (n, 2)), ("velocity", (n, 2)), ("spin", (n, 3)), ("times", (times.size,))):
            value = np.asarray(getattr(shot, name), float)
            if value.shape != shape:
                raise ValueError(f"shot {k}: {name} has shape {value.shape}; {n} balls need {shape}")
            if not np.isfinite(value).all():
                raise ValueError(f"shot {k}: {name} holds {value[~np.isfinite(value)][0]}; give finite numbers")
        if times.size and (times[0] < 0 or (times[1:] < times[:-1]).any()):
            raise ValueError(f"shot {k}: times go backwards or below 0; give increasing times from 0")


def simulate(
    model: Model,
    shots: Sequence[Shot],
    progress: Callable[[int], None] | None = None,
    *,
    threads: int = 0,
    contacts: str = "clusters",
    jaws: bool = False,
) -> list[Track]:
    """Play shots on a model; a parameter that is an array gives each shot its own value.

    The model's `engine` plays them: "events" (where the model has an effect for cloth, balls and cushions, and none
    that edits the MJCF) or "mujoco".

    Args:
        model: table, ball and effects; parameters are numbers or (len(shots),) arrays.
        shots: the balls' states at t = 0 and the times wanted.
        progress: called with the number of shots done.
        threads: that step the simulations; 0 for one a core.
        contacts: which impacts go through springs in small steps in the event engine: "clusters" of three bodies or
            more, or "never" any. The others are carried through by their impulse. In MuJoCo all are contacts.
        jaws: whether pockets have jaws and an edge (models/analytic/pocket.py), which needs effects for cloth, balls
            and cushions; without, a mouth takes what comes into it. Impacts at a jaw are carried through by their
            impulse; balls in `Shot.staying` meet straight cushions in place of pockets.

    Returns:
        A track for every shot, in order; the same bytes at any thread count, and the same to
        rounding whatever else is in the batch.
    """
    if contacts not in CONTACT_MODES:
        raise ValueError(f"contacts is {contacts!r}; choose from {', '.join(CONTACT_MODES)}")
    _check(model, shots, jaws)
    if model.engine == "events" and not lacking(model):
        done, tracks_found = 0, []
        for start in range(0, len(shots), CHUNK_SIZE):
            part = np.arange(start, min(start + CHUNK_SIZE, len(shots)))
            few = [shots[int(k)] for k in part]
            tracks_found += play(model.select(part), few, threads=threads, jaws=jaws, clusters=contacts == "clusters")
            done += part.size
            if progress:
                progress(done)
        return tracks_found
    from models.mujoco.play import play as play_in_mujoco  # MuJoCo takes a second to import

    return play_in_mujoco(model, shots, threads=threads, jaws=jaws, progress=progress)
