"""How cost grows: with balls, effects and threads of shots, with clips of `check`, `compare` and `fit`.

Every series ends with its exponent between its first and last: 1 is linear. `noted` adds one dated row to the table in
docs/benchmarks.md, so that a version that is slower shows.
"""

from __future__ import annotations

import datetime
import math
import os
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import tomli_w

from models.effect_catalogue import effect_class
from models.engine.play import finish, play
from models.model_file import Model, full_model
from models.shot import Shot
from models.table.snooker import SNOOKER_BALL, SNOOKER_TABLE
from tests.bench.speed import best

ROOT = Path(__file__).resolve().parents[2]
NOTES = ROOT / "docs" / "benchmarks.md"
BALLS = (2, 4, 8, 16, 22)
EFFECTS = ("table_tilt", "speed_drag", "side_curve", "cushion_restitution_speed", "spin_slide_coupling", "air_drag")
EFFECT_COUNTS, THREADS, SHOTS = (0, 1, 3, 6), (1, 2), 48
MANY = 40  # times as many shots for threads, whose start is to cost little
VERBS = ("check", "compare", "fit")
CLIPS, MADE_CLIPS, CLIP_SECONDS, SEED = (50, 200, 800), 50, 3, 5


def spread(balls: int, count: int = SHOTS) -> list[Shot]:
    """Fast shots of one ball among others at rest."""
    rng, limits = np.random.default_rng(balls), SNOOKER_TABLE.centre_limits(SNOOKER_BALL)
    made: list[Shot] = []
    while len(made) < count:
        xy = rng.uniform(-limits, limits, (balls, 2))
        gaps = np.linalg.norm(xy[:, None] - xy, axis=-1) + np.eye(balls)
        if gaps.min() < SNOOKER_BALL.diameter:
            continue
        v, w, heading = np.zeros((balls, 2)), np.zeros((balls, 3)), rng.uniform(-np.pi, np.pi)
        v[0] = rng.uniform(2.0, 5.0) * np.array([np.cos(heading), np.sin(heading)])
        w[0] = rng.normal(0, 30, 3)
        made.append(Shot(tuple(f"ball {k}" for k in range(balls)), xy, v, w, np.linspace(0, 5, 151)))
    return made


def track_seconds(model: Model, shots: Sequence[Shot], threads: int = 1) -> float:
    """Time until the tracks of shots are known [s]."""
    play(model, shots[:2], threads=threads)  # compiles
    return best(lambda: play(model, shots, threads=threads), 2)


def milliseconds(model: Model, shots: Sequence[Shot]) -> float:
    """Time of a shot, on one thread [ms]."""
    return 1e3 * track_seconds(model, shots) / len(shots)


def ends_seconds(model: Model, shots: Sequence[Shot], threads: int) -> float:
    """Time until the ends of shots are known, as the planner asks for them, without tracks [s]."""
    state = [np.array([getattr(s, name) for s in shots]) for name in ("position", "velocity", "spin")]
    return best(lambda: finish(model, *state, until=float(shots[0].times[-1]), threads=threads), 3)


def exponent(sizes: Sequence[float], costs: Sequence[float]) -> float:
    """By which power cost grows from the first size to the last."""
    return math.log(costs[-1] / costs[0]) / math.log(sizes[-1] / sizes[0])


def shot_growth() -> tuple[list[tuple[str, ...]], dict[str, str]]:
    """Rows for people, and the figures that are noted."""
    plain = full_model(SNOOKER_TABLE, SNOOKER_BALL)
    balls = [milliseconds(plain, spread(n)) for n in BALLS]
    models = [plain]
    for name in EFFECTS:
        models.append(models[-1].add(effect_class(name)()))
    shots = spread(8)
    effects = [milliseconds(models[n], shots) for n in EFFECT_COUNTS]
    many = shots * MANY
    ends, tracks = (
        [1e3 * seconds(models[3], many, n) / len(many) for n in THREADS] for seconds in (ends_seconds, track_seconds)
    )
    gain, counts = ends[0] / ends[-1], ", ".join(map(str, THREADS))
    power, dearest = exponent(BALLS, balls), EFFECT_COUNTS[1 + int(np.argmax(np.diff(effects)))]
    rows = [
        ("growth of a shot of 5 s", "ms a shot", "remark"),
        (f"  {', '.join(map(str, BALLS))} balls", _listed(balls), f"power {power:.2f} of the balls"),
        (
            f"  {', '.join(map(str, EFFECT_COUNTS))} effects, 8 balls", _listed(effects),
            f"dearest step: to {dearest}, with {EFFECTS[dearest - 1]}",
        ),
        (f"  {counts} threads, ends of {len(many)} shots, 3 effects", _listed(ends), f"{gain:.2f} times as fast"),
        (f"  {counts} threads, tracks of the same", _listed(tracks), f"{tracks[0] / tracks[-1]:.2f} times as fast"),
    ]  # fmt: skip
    noted = {
        "2 balls [ms]": f"{balls[0]:.2f}", "22 balls [ms]": f"{balls[-1]:.2f}", "power of balls": f"{power:.2f}",
        "6 effects over none": f"{effects[-1] / effects[0]:.1f}", "2 threads over 1": f"{gain:.2f}",
    }  # fmt: skip
    return rows, noted


def _listed(values: Sequence[float]) -> str:
    return ", ".join(f"{v:.2f}" for v in values)


def grown(source: Path, count: int, out: Path) -> None:
    """A clip set of so many clips: those of another one again and again, under names of their own."""
    header = tomllib.loads((source / "clips.toml").read_text(encoding="utf-8"))
    entries = header["clip"]
    (out / "clips").mkdir(parents=True)
    header["clip"] = []
    for k in range(count):
        entry = dict(entries[k % len(entries)])
        file = f"clips/{k + 1:05d}.csv"
        (out / file).write_bytes((source / entry["file"]).read_bytes())
        header["clip"].append(entry | {"file": file})
    (out / "clips.toml").write_text(tomli_w.dumps(header), encoding="utf-8")


def measured(words: Sequence[str]) -> tuple[float, float]:
    """Time of a command [s], and the most memory that it or a child of it took [MB]."""
    code = (
        "import resource, subprocess, sys; r = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL); "
        "print(resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss); sys.exit(r.returncode)"
    )
    began = time.perf_counter()
    ran = subprocess.run(
        [sys.executable, "-c", code, sys.executable, "-m", *words], cwd=ROOT, capture_output=True, text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    if ran.returncode:
        raise RuntimeError(f"{' '.join(words)}: status {ran.returncode}: {ran.stderr[-300:]}")
    peak = float(ran.stdout.split()[-1])
    return time.perf_counter() - began, peak / (1e6 if sys.platform == "darwin" else 1e3)


def clip_growth(
    counts: Sequence[int] = CLIPS, verbs: Sequence[str] = VERBS
) -> tuple[list[tuple[str, ...]], dict[str, str]]:
    """Time and memory of the commands that read clip sets, over the number of clips."""
    rows: list[tuple[str, ...]] = [("growth with clips", "s", "MB", "power")]
    noted: dict[str, str] = {}
    with tempfile.TemporaryDirectory(prefix="cuelab-bench-") as place:
        folder = Path(place)
        made = ["--clips", str(MADE_CLIPS), "--seconds", str(CLIP_SECONDS), "--seed", str(SEED)]
        measured(["tests.truth", str(folder / "made"), *made])
        for count in counts:
            grown(folder / "made", count, folder / str(count))
        for verb in verbs:
            outs = [["--out", str(folder / f"fitted-{n}.toml")] if verb == "fit" else [] for n in counts]
            found = [
                measured(["sysid.cli", verb, str(folder / str(n)), *out]) for n, out in zip(counts, outs, strict=True)
            ]
            took, memory = [f[0] for f in found], [f[1] for f in found]
            rows.append((
                f"  {verb}, {', '.join(map(str, counts))} clips", ", ".join(f"{t:.1f}" for t in took),
                ", ".join(f"{m:.0f}" for m in memory), f"{exponent(counts, took):.2f}",
            ))  # fmt: skip
            noted[f"{verb} {counts[-1]} clips [s]"] = f"{took[-1]:.0f}"
            noted[f"{verb} {counts[-1]} clips [MB]"] = f"{memory[-1]:.0f}"
    return rows, noted


def noted(figures: dict[str, str], today: datetime.date, version: str, page: Path = NOTES) -> None:
    """Add a dated row of figures to the last table of a page; a table of other columns is followed by a new one."""
    text = page.read_text(encoding="utf-8").rstrip("\n")
    header = "| " + " | ".join(["date", "version", "cores", *figures]) + " |"
    if header not in text.splitlines():
        text += f"\n\n{header}\n" + "|---" * (3 + len(figures)) + "|"
    row = [today.isoformat(), version, str(os.cpu_count()), *figures.values()]
    page.write_text(f"{text}\n| " + " | ".join(row) + " |\n", encoding="utf-8")
