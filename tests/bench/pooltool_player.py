"""Plays shots in pooltool, and is run by the Python that has it: a judge that nobody here wrote.

    python tests/bench/pooltool_player.py JOB.npz OUT.npz

In: `system` and `laws`, names of files ("" for pooltool's own laws); `rvw` (n, balls, 3, 3) states at the start in its
frame, NaN for a ball that is not there; `times` (n,), at which places are wanted, NaN for the end; `keys` and `values`
(n, keys), constants of all balls by the names of its `BallParams`. Out: `xy` (n, balls, 2) at that time, `fell` (n,
balls) names of pockets, `first` (n,) the ball that the first one met, -1 for none, `hits` (n,) its cushions before
that, `second` (n,) when the second impact was. Imports nothing of this project.
"""

import sys

import attrs
import numpy as np
import pooltool as pt
from pooltool.events import EventType
from pooltool.physics.engine import PhysicsEngine
from pooltool.physics.resolve.resolver import Resolver, default_resolver

MAX_EVENTS = 3000
CUSHIONS = (EventType.BALL_LINEAR_CUSHION, EventType.BALL_CIRCULAR_CUSHION)


def main(job_file, out_file):
    """Play all shots of a job."""
    job = np.load(job_file)
    base = pt.System.load(str(job["system"]))
    laws = str(job["laws"])
    engine = PhysicsEngine(resolver=Resolver.load(laws) if laws else default_resolver())
    names, n = list(base.balls), len(job["rvw"])
    xy, fell = np.full((n, len(names), 2), np.nan), np.full((n, len(names)), "", "U4")
    first, hits, second = np.full(n, -1), np.zeros(n, int), np.full(n, np.inf)
    keys = [str(key) for key in job["keys"]]
    for k in range(n):
        system = base.copy()
        constants = dict(zip(keys, map(float, job["values"][k]), strict=True))
        for b, name in enumerate(names):
            rvw = job["rvw"][k, b]
            if np.isnan(rvw).any():
                del system.balls[name]
                continue
            ball = system.balls[name]
            ball.params = attrs.evolve(ball.params, **constants)
            ball.state.rvw[:] = rvw
            ball.state.s = 2 if np.any(rvw[1:]) else 0
        system.cue.cue_ball_id = names[0]
        pt.simulate(system, engine=engine, inplace=True, max_events=MAX_EVENTS)
        impacts = [e for e in system.events if e.event_type in (EventType.BALL_BALL, *CUSHIONS)]
        if len(impacts) > 1:
            second[k] = impacts[1].time
        for event in impacts:
            if event.event_type == EventType.BALL_BALL and names[0] in event.ids:
                first[k] = names.index(next(i for i in event.ids if i != names[0]))
                break
            hits[k] += event.event_type in CUSHIONS and event.ids[0] == names[0]
        for event in system.events:
            if event.event_type == EventType.BALL_POCKET:
                fell[k, names.index(event.ids[0])] = event.ids[1]
        wanted = float(job["times"][k])
        for b, name in enumerate(names):
            if name not in system.balls:
                continue
            ball = system.balls[name]
            if np.isnan(wanted):
                state = ball.state
            else:
                state = pt.interpolate_ball_states(ball, [min(wanted, ball.history[-1].t)])[0]
            xy[k, b] = state.rvw[0, :2] if state.s != 4 else np.nan
    np.savez(out_file, xy=xy, fell=fell, first=first, hits=hits, second=second)


if __name__ == "__main__":
    main(*sys.argv[1:])
