"""Makes the systems of this folder, with a Python that has pooltool 0.6: `PYTHON make.py`.

Shots on its own 7 ft table, one of them into a pocket, one with a cushion. Events are left out of the files, which
keeps them small; `truth.json` has where pooltool itself puts the balls at some times.
"""

import json
from pathlib import Path

import numpy as np
import pooltool as pt
from pooltool.physics.engine import PhysicsEngine
from pooltool.physics.resolve.resolver import default_resolver

HERE = Path(__file__).parent
TIMES = [0.0, 0.11, 0.37, 0.6, 0.9, 1.3]


def shot(v0, phi, a, b, places):
    """A system that was simulated."""
    table = pt.Table.default()
    balls = {name: pt.Ball.create(name, xy=(table.w * x, table.l * y)) for name, (x, y) in places.items()}
    system = pt.System(cue=pt.Cue(cue_ball_id="cue", V0=v0, phi=phi, a=a, b=b, theta=5.0), table=table, balls=balls)
    engine = PhysicsEngine(resolver=default_resolver())
    return pt.simulate(system, engine=engine)


def kept(system):
    """The system without its events."""
    system = system.copy()
    system.events = []
    return system


def main():
    """Write the files."""
    cut = shot(0.9, 88.0, -0.2, 0.1, {"cue": (0.5, 0.4), "1": (0.5, 0.5), "2": (0.2, 0.8)})
    rail = shot(0.8, 10.0, 0.3, -0.2, {"cue": (0.7, 0.3), "1": (0.1, 0.9)})
    pot = shot(
        0.9, 45.0, 0.0, 0.0, {"cue": (1 - 0.3 / 0.9906, 1 - 0.3 / 1.9812), "1": (1 - 0.15 / 0.9906, 1 - 0.15 / 1.9812)}
    )
    truth = {}
    for name, system in (("cut", cut), ("rail", rail), ("pot", pot)):
        truth[name] = {
            ball: [s.rvw[0, :2].tolist() for s in pt.interpolate_ball_states(one, np.array(TIMES), extrapolate=True)]
            for ball, one in system.balls.items()
        }
        print(name, [(e.event_type, e.ids, round(e.time, 3)) for e in system.events])
    (HERE / "truth.json").write_text(json.dumps({"times": TIMES, "places": truth}, indent=None) + "\n")
    kept(cut).save(HERE / "cut.json")
    kept(rail).save(HERE / "rail.json")
    kept(pt.continuize(pot, dt=0.02)).save(HERE / "pot.msgpack")
    several = pt.MultiSystem()
    for system in (cut, rail):
        several.append(kept(system))
    several.save(HERE / "several.msgpack")
    for name in ("cut", "rail"):
        data = json.loads((HERE / f"{name}.json").read_text())
        (HERE / f"{name}.json").write_text(json.dumps(data) + "\n")


if __name__ == "__main__":
    main()
