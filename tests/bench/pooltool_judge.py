"""Plans judged by pooltool, which nobody here wrote: odds that were promised, against odds that it makes of them.

    python -m tests.bench.pooltool_judge --python PYTHON [--plans 100] [--plays 64] [--kept FILE.jsonl] [--json FILE]

PYTHON has pooltool 0.6 (tests/bench/pooltool.txt); $CUELAB_POOLTOOL says the same. Scenes are drawn on the 7 ft table
that pooltool's authors measured. Half of the plans are for scenes with a direct way to a pocket, half for such as have
none, so that either ball has to go by way of a cushion first. Each plan is played again and again in pooltool, with the
launcher's errors, and with constants drawn anew from what the plan knew of them. Everything goes through the exported
files (sysid/pooltool), by pooltool's laws that come nearest to ours, and again by its own. FILE.jsonl keeps the plans,
which take most of the time.

Two models are planned on: the base as nobody measured it, whose constants vary as published ones do, and the same with
the standard deviations of a fit. Before, shots of two balls are compared in place and time.
"""

from __future__ import annotations

import argparse
import dataclasses
import importlib.util
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from models.commands.console import table
from models.model_file import Estimate, Model, full_model
from models.shot import GRAVITY, Array, Shot
from models.simulation.simulate import simulate
from models.table.presets import TableSet, find_table
from planner.evaluation.play import Player
from planner.evaluation.published import with_published_spread
from planner.evaluation.risk import draw_errors
from planner.launcher.execution import Execution
from planner.launcher.stroke import LauncherModel
from planner.planning import make_plan
from planner.scene import Goal, Scene
from planner.search.candidates import all_routes
from planner.search.search import Effort
from planner.study.draws import PRIOR_SDS
from sysid.pooltool.document import write_document
from sysid.pooltool.export import nearest_laws, system_of
from sysid.pooltool.frame import turned_there
from sysid.pooltool.losses import BEFORE_S, random_shots
from sysid.pooltool.table import frame_of

PLAYER = Path(__file__).with_name("pooltool_player.py")
TABLE = "pool 7 ft"
NAMES = ("cue", "object", "b0", "b1", "b2", "b3")
BALLS = {"direct": 3, "cushion": 6}  # in a scene; the more there are, the fewer ways are open
CLEARANCE_RADII = 3.0  # between centres
SEED, SHOTS = 11, 200
THEIRS = {  # their names of our constants, and what they are in ours
    "decoupled_cloth.slide": ("u_s", 1.0), "decoupled_cloth.roll": ("u_r", 1.0),
    "decoupled_cloth.spin": ("u_sp_proportionality", 0.4 / GRAVITY), "ball_impact.restitution": ("e_b", 1.0),
    "ball_impact.friction": ("u_b", 1.0), "cushion_impact.restitution": ("e_c", 1.0),
    "cushion_impact.friction": ("f_c", 1.0),
}  # fmt: skip
MIN_FRICTION = 1e-9
EFFORT = Effort(
    checked=1
)  # the usual one, but for plays in MuJoCo, which take most of the time and change an order alone


def judge_python(given: str | None = None) -> str:
    """The Python that has pooltool; "" where none is known."""
    if found := given or os.environ.get("CUELAB_POOLTOOL"):
        return found
    return sys.executable if importlib.util.find_spec("pooltool") is not None else ""


@dataclasses.dataclass(frozen=True)
class Judge:
    """pooltool with an exported model, in a process of its own."""

    python: str
    folder: Path
    model: Model

    def export(self) -> None:
        """Write system and laws."""
        laws, n = nearest_laws(self.model), len(NAMES)
        places = np.column_stack([np.linspace(-0.6, 0.6, n), np.zeros(n)])
        shot = Shot(NAMES, places, np.zeros((n, 2)), np.zeros((n, 3)), np.zeros(1))
        write_document(system_of(self.model, laws, shot), self.folder / "system.json")
        write_document(laws.resolver, self.folder / "system.laws.json")

    def play(
        self, position: Array, velocity: Array, spin: Array, *, own: bool, times: Array | None = None,
        values: Mapping[str, Array] | None = None,
    ) -> dict[str, Array]:  # fmt: skip
        """Shots (n, balls, 2), (n, balls, 2), (n, balls, 3), by its own laws or ours; places at `times` (n,) [s]."""
        n, balls = position.shape[:2]
        rvw = np.full((n, len(NAMES), 3, 3), np.nan)
        rvw[:, :balls] = 0.0  # a place of NaN leaves the ball out
        frame = frame_of(self.model.table, self.model.ball)
        rvw[:, :balls, 0, :2], rvw[:, :balls, 0, 2] = frame.place(position), self.model.ball.radius
        rvw[:, :balls, 1, :2], rvw[:, :balls, 2] = turned_there(velocity), turned_there(spin)
        values = values or {}
        keys = [THEIRS[name][0] for name in values]
        columns = [np.maximum(THEIRS[name][1] * v, MIN_FRICTION) for name, v in values.items()]
        job, out = self.folder / "job.npz", self.folder / "out.npz"
        np.savez(
            job, system=str(self.folder / "system.json"), laws="" if own else str(self.folder / "system.laws.json"),
            rvw=rvw, times=np.full(n, np.nan) if times is None else times, keys=np.array(keys, "U24"),
            values=np.column_stack(columns) if columns else np.zeros((n, 0)),
        )  # fmt: skip
        env = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"} | {"HOME": str(self.folder)}
        subprocess.run([self.python, str(PLAYER), str(job), str(out)], check=True, env=env)
        found = dict(np.load(out))
        return found | {"xy": frame.place_here(found["xy"])[:, :balls], "fell": found["fell"][:, :balls]}


def apart(judge: Judge, own: bool) -> tuple[Array, Array]:
    """How far balls are from ours at the second impact and at the end: (n,) [m]; NaN where only one has a ball fall."""
    shots = random_shots(judge.model, SHOTS)
    p, v, w = (np.array([getattr(s, k) for s in shots]) for k in ("position", "velocity", "spin"))
    here, there = simulate(judge.model, shots, jaws=True), judge.play(p, v, w, own=own)
    times = [sorted(e.time for e in track.events if e.kind != "pocket") for track in here]
    second = np.array([t[1] if len(t) > 1 else np.inf for t in times])
    last = np.minimum(second, there["second"])
    last = np.where(np.isfinite(last), last, shots[0].times[-1]) - BEFORE_S
    early = [dataclasses.replace(shot, times=np.array([0.0, t])) for shot, t in zip(shots, last, strict=True)]
    at_second = judge.play(p, v, w, own=own, times=last)["xy"]
    places = [
        np.array([track.position[-1] for track in tracks]) for tracks in (simulate(judge.model, early, jaws=True), here)
    ]
    return tuple(_largest(a - b) for a, b in zip(places, (at_second, there["xy"]), strict=True))  # type: ignore[return-value]


def _largest(off: Array) -> Array:
    """The largest distance of a ball that is on the table: (n,) [m]."""
    return np.nanmax(np.hypot(off[..., 0], off[..., 1]), axis=1, initial=0.0)


def draw_scene(rng: np.random.Generator, known: TableSet, kind: str) -> Scene:
    """A scene with an open direct way to a pocket, or with none."""
    limit, count = known.table.centre_limits(known.ball) - 0.01, BALLS[kind]
    while True:
        places = rng.uniform(-limit, limit, (count, 2))
        one, other = np.triu_indices(count, 1)
        if np.hypot(*(places[one] - places[other]).T).min() < CLEARANCE_RADII * known.ball.radius:
            continue
        scene = Scene(known.table, known.ball, NAMES[:count], places, Goal(NAMES[0], NAMES[1], None))
        if any(r.direct and not r.obstacle for r in all_routes(scene)) == (kind == "direct"):
            return scene


def planned(file: Path, models: Mapping[str, Model], plans: int) -> list[dict[str, Any]]:
    """Plans on each model, half of either kind and in turn, of the same scenes; those that the file has are kept."""
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    have = {(row["kind"], row["number"], row["model"]): row for row in rows}
    known = find_table(TABLE)
    rngs = {kind: np.random.default_rng([SEED, len(kind)]) for kind in BALLS}
    done, number, found = dict.fromkeys(((m, k) for m in models for k in BALLS), 0), 0, list[dict[str, Any]]()
    while min(done.values()) < plans // 2:
        number += 1
        for kind, rng in rngs.items():
            scene = draw_scene(rng, known, kind)  # type: ignore[arg-type]
            for name, model in models.items():
                if done[name, kind] >= plans // 2:
                    continue
                row = have.get((kind, number, name))
                if row is None:
                    made = make_plan(scene, model, seed=number, effort=EFFORT)
                    kept = {key: made.get(key) for key in ("stroke", "kind", "pot_probability", "scene")}
                    row = {"kind": kind, "number": number, "model": name, "plan": kept}
                    with file.open("a") as out:
                        out.write(json.dumps(row) + "\n")
                if row["plan"]["stroke"] is not None:
                    done[name, kind] += 1
                    found.append(row)
    return found


def judged(
    judge: Judge, rows: Sequence[Mapping[str, Any]], models: Mapping[str, Model], plays: int
) -> list[dict[str, Any]]:
    """Odds of each plan's pot: promised, and made by the same plays here, in pooltool by our laws, and by its own."""
    n, most = len(rows) * plays, len(NAMES)
    p, v, w = np.full((n, most, 2), np.nan), np.zeros((n, most, 2)), np.zeros((n, most, 3))
    values, found = {name: np.empty(n) for name in THEIRS}, list[dict[str, Any]]()
    launcher = LauncherModel()
    for k, row in enumerate(rows):
        plan, some = row["plan"], slice(k * plays, (k + 1) * plays)
        model = with_published_spread(models[row["model"]])
        names = tuple(plan["scene"]["balls"])
        position = np.array([plan["scene"]["balls"][name] for name in names])
        scene = Scene(model.table, model.ball, names, position, Goal(*names[:2], None))
        q = np.array([[plan["stroke"][key] for key in ("speed", "azimuth", "side", "height")]])
        samples = draw_errors(model, Execution(), plays, 1000 + row["number"])
        here = samples.play(Player(model, scene, launcher), q)
        played = samples.execution.perturb(q, samples.normal).reshape(-1, 4)
        p[some, : len(names)] = position
        v[some, 0], w[some, 0] = launcher.launch(played, model.ball)
        for name, column in values.items():
            column[some] = samples.values.get(name, float(model.parameters()[name]))
        way = "kick" if "by way of" in plan["kind"] else "bank" if " off the " in plan["kind"] else "direct"
        odds = {"promised": plan["pot_probability"]["value"], "here": float(here.potted.mean())}
        found.append({"model": row["model"], "way": way, "number": row["number"], **odds})
    for name, own in (("nearest", False), ("own", True)):
        fell = judge.play(p, v, w, own=own, values=values)["fell"][:, 1] != ""
        for one, odds in zip(found, fell.reshape(-1, plays).mean(axis=1), strict=True):
            one[name] = float(odds)
    return found


def summary(rows: Sequence[Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """Mean odds by model and way, in %."""
    columns = ("promised", "here", "nearest", "own")
    out: list[tuple[str, ...]] = [
        ("odds of the pot, %", "plans", "promised", "here again", "pooltool", "by its own laws")
    ]
    for model in dict.fromkeys(row["model"] for row in rows):
        for label, ways in (
            ("direct", ("direct",)),
            ("cushion first", ("kick", "bank")),
            ("  cue ball first", ("kick",)),
        ):
            some = [row for row in rows if row["model"] == model and row["way"] in ways]
            if some:
                means = [f"{100 * np.mean([row[c] for row in some]):.1f}" for c in columns]
                out.append((f"{model}: {label}", str(len(some)), *means))
    return out


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--python")
    parser.add_argument("--plans", type=int, default=100)
    parser.add_argument("--plays", type=int, default=64)
    parser.add_argument("--kept", type=Path)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    python = judge_python(given.python)
    if not python:
        print("no Python with pooltool is known: name it with --python or $CUELAB_POOLTOOL (tests/bench/pooltool.txt)")
        return 1
    known = find_table(TABLE)
    base = full_model(known.table, known.ball)  # type: ignore[arg-type]
    fitted = dataclasses.replace(
        base, estimates={name: Estimate(sd, "as a fit has it") for name, sd in PRIOR_SDS.items()}
    )
    with tempfile.TemporaryDirectory() as folder:
        judge = Judge(python, Path(folder), base)
        judge.export()
        lines: list[tuple[str, ...]] = [
            ("off ours, mm: median / 95 % / worst", "at the second impact", "where balls stop")
        ]
        for label, own in (("our laws, exported", False), ("its own laws", True)):
            cells = [
                " / ".join(f"{1e3 * q:.2g}" for q in np.nanquantile(off, (0.5, 0.95, 1))) for off in apart(judge, own)
            ]
            lines.append((label, *cells))
        print(table(lines) + "\n", flush=True)
        models = {"not fitted": base, "fitted": fitted}
        plans = planned(given.kept or Path(folder) / "plans.jsonl", models, given.plans)
        rows = judged(judge, plans, models, given.plays)
    print(table(summary(rows)))
    if given.json:
        given.json.write_text(json.dumps({"apart": lines, "plans": rows}, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
