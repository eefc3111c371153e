"""`robot learn`: the closed loop, at a table or on the emulator, and there how near it came to what it really is.

What the emulator hides is drawn from the seed and stays in this process: DIR/emulated.json holds only a fingerprint of
it, by which a series goes on with the same table and launcher or not at all; DIR/hidden.toml and DIR/hidden_cue.json
are written when the series has ended. Report and recording are made from the folder alone, every time anew.
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import math
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from models.console import DONE, INTERRUPTED, Progress, Verb, check_outputs, table, write_json
from models.errors import BadInput
from robot.cli.common import (
    camera_of,
    confirmed,
    emulated_only,
    filmed,
    launcher_at,
    seed_of,
    seeded,
    settings_of,
    wired,
    with_camera,
    with_effects,
)

if TYPE_CHECKING:
    from models.shot import Ball, Table
    from robot.camera.live import LiveCamera
    from robot.learning.emulated_rig import EmulatedStand
    from robot.learning.history import Refit, Story
    from robot.learning.live_rig import LiveStand
    from robot.learning.loop import Course

FORMAT, CUE_FORMAT, EMULATED_FORMAT = "billiard-learn/1", "billiard-hidden-cue/1", "billiard-emulated/1"
HIDDEN = 7  # beside the seed: its draws are not the scenes'


def add(verb: Verb) -> None:
    """The verb with its options."""
    text = "plan, play, film, refit table and launcher, plan on; without --port on the emulated launcher and table"
    one = verb("learn", run, text)
    one.add_argument("--out", metavar="DIR", required=True, help="folder of the series; one that is there goes on")
    text = "model to begin with (default: the base; emulated, on a full-size table)"
    one.add_argument("--model", metavar="START.toml", help=text)
    text = "cueing map to begin with (default: the usual constants)"
    one.add_argument("--map", metavar="MAP.toml", help=text)
    one.add_argument("--shots", metavar="N", type=int, default=60, help="at most (default: 60)")
    one.add_argument("--every", metavar="N", type=int, default=10, help="shots between refits (default: 10)")
    one.add_argument("--balls", metavar="N", type=int, default=2, help="in each scene, 2 to 8 (default: 2)")
    seeded(one, 0)
    one.add_argument("--all", action="store_true", help="play all shots, also where nothing improves any more")
    wired(one, required=False)
    with_camera(one, required=False)
    one.add_argument("--yes", action="store_true", help="strike without asking; look at the table first")
    truth = one.add_mutually_exclusive_group()
    text = "what the emulated table really is (default: drawn from the seed)"
    truth.add_argument("--hidden", metavar="TABLE.toml", help=text)
    truth.add_argument("--effect", metavar="NAME", help="effect of the table that is drawn (default: drawn too)")
    text = "of every stroke, for the launcher's own scatter (default: 20)"
    one.add_argument("--repeats", metavar="N", type=int, default=20, help=text)
    one.add_argument("--json", metavar="FILE", help="the same figures")
    with_effects(one)


def run(args: argparse.Namespace, progress: Progress) -> int:
    """Play a series or go on with it, then tell what it came to."""
    check_outputs(args.json)
    if args.repeats < 0:
        raise BadInput(f"--repeats {args.repeats}: give 0 or more")
    from models.mjcf.snooker import SNOOKER_BALL, SNOOKER_TABLE
    from robot.learning.loop import begin, learn

    folder = Path(args.out)

    def say(line: str) -> None:
        progress.close()
        print(line, flush=True)

    try:
        if args.port:
            with _camera(args, folder) as camera:
                course = _course(args, camera.table, camera.ball)
                story = learn(folder, course, _at_the_table(args, camera, say), say, progress)
            emulated = None
        else:
            emulated_only(args)
            course = _course(args, SNOOKER_TABLE, SNOOKER_BALL)
            emulated = _emulated(args, course)
            begin(folder, course)
            _keep_to(folder, emulated)
            say("no --port: on the emulated launcher and table")
            story = learn(folder, course, emulated, say, progress)
            _reveal(folder, emulated)
        told = figures(story, course, emulated)
        progress.close()
        print(f"\n{text_of(told)}")
        if args.json:
            write_json(args.json, told)
        _draw(folder, story, progress)
        progress.close()
        hidden = ", hidden.toml, hidden_cue.json" if emulated else ""
        print(f"\nseries: {folder} (report.html, story.png, story.rrd{hidden})")
    except KeyboardInterrupt:
        progress.close()
        print(f"robot learn: interrupted; {folder} is kept: the same command goes on from there", file=sys.stderr)
        return INTERRUPTED
    return DONE


def _camera(args: argparse.Namespace, folder: Path) -> LiveCamera:
    """The camera of a series at a table, which it cannot do without."""
    for name in ("hidden", "effect"):
        if getattr(args, name):
            raise BadInput(f"--{name} belongs to the emulated table; leave it out, or leave --port out")
    if not filmed(args):
        raise BadInput("--port: a series needs a camera; give --camera CAM.toml and --video SOURCE")
    return camera_of(args, folder / "films")


def _at_the_table(args: argparse.Namespace, camera: LiveCamera, say: Callable[[str], None]) -> LiveStand:
    """The stand at a port, with whoever is at the terminal."""
    from robot.learning.live_rig import LiveStand

    settings = settings_of(args)

    def confirm(what: str) -> bool:
        return args.yes or confirmed(what, "the stand is aligned")

    def ready(what: str) -> bool:
        say(what)
        try:
            return input("then press return (q ends the series here): ").strip().lower() != "q"
        except EOFError:
            return False

    return LiveStand(camera, settings, lambda: launcher_at(args, settings), confirm, ready, say)


def _course(args: argparse.Namespace, on: Table, ball: Ball) -> Course:
    """What the command line asks for, without a model on the base for a table and its balls."""
    from models.analytic.cue_impulse import NAMES, Constants, Geometry
    from models.model_file import full_model, read_model
    from planner.launcher.cueing_map import CueingMap, read_map
    from planner.launcher.execution import Execution
    from planner.launcher.mapped import with_map
    from planner.launcher.stroke import LauncherModel
    from robot.emulator.table import BASE
    from robot.learning.loop import Course

    model = read_model(args.model) if args.model else full_model(on, ball)
    if lacking := sorted(set(BASE) - {e.name() for e in model.stack()}):
        raise BadInput(f"{args.model}: lacks {', '.join(lacking)}; give a model that starts from the base")
    if args.map:
        cueing_map = read_map(args.map)
    else:
        unknown = np.full((len(NAMES), len(NAMES)), math.nan)
        cueing_map = CueingMap(Constants(), Geometry(model.ball), unknown, Execution())
    with_map(LauncherModel(), cueing_map, model.ball)  # of these balls, or refused before anything is played
    course = Course(
        model, cueing_map, args.shots, args.every, seed_of(args), args.balls, stops=not args.all
    )  # fmt: skip
    _ = course.study  # says what is wrong with balls and table
    return course


def _emulated(args: argparse.Namespace, course: Course) -> EmulatedStand:
    """The emulated stand with its hidden constants."""
    from models.model_file import read_model
    from robot.device.settings import Settings
    from robot.emulator.table import EmulatedTable
    from robot.learning.emulated_rig import EmulatedStand, draw_hidden_cue, draw_hidden_table

    start = course.model
    rng = np.random.default_rng([course.seed, HIDDEN])
    cue = draw_hidden_cue(rng)
    if args.hidden:
        hidden = read_model(args.hidden)
        if (hidden.table, hidden.ball) != (start.table, start.ball):
            raise BadInput(f"{args.hidden}: is of another table or ball than the model to begin with; name one of its")
    else:
        hidden = draw_hidden_table(start, rng, args.effect)
    plays = EmulatedTable(hidden, {"white": (0.0, 0.0)}, 0.0).model  # what of it acts there; refuses one without base
    if args.effect and args.effect not in {e.name() for e in plays.effects}:
        raise BadInput(f"--effect {args.effect}: changes no shot on the emulated table; choose one that moves balls")
    settings = Settings()
    stage = dataclasses.replace(settings.stage, ball_radius_mm=1e3 * start.ball.radius)
    return EmulatedStand(hidden, cue, dataclasses.replace(settings, stage=stage), course.seed, args.repeats)


def _keep_to(folder: Path, stand: EmulatedStand) -> None:
    """Note what is hidden, as a fingerprint that nobody can read; BadInput where the series was begun with another."""
    hidden = repr((sorted(stand.model.parameters().items()), sorted(dataclasses.asdict(stand.cue).items())))
    now = {"format": EMULATED_FORMAT, "hidden": hashlib.sha256(hidden.encode()).hexdigest(), "repeats": stand.repeats}
    path = folder / "emulated.json"
    if not path.is_file():
        write_json(str(path), now)
        return
    from robot.learning.history import read_json

    then = read_json(path, EMULATED_FORMAT)
    for key, word in (("hidden", "table or launcher"), ("repeats", "number of repeats")):
        if then.get(key) != now[key]:
            raise BadInput(f"{folder}: was begun with another {word} emulated; go on with that, or name another folder")
    for name in ("hidden.toml", "hidden_cue.json"):  # there once the series has ended
        (folder / name).unlink(missing_ok=True)


def _reveal(folder: Path, stand: EmulatedStand) -> None:
    """Write what was hidden."""
    from models.model_file import write_model

    write_model(stand.model, folder / "hidden.toml")
    told = {"format": CUE_FORMAT, "constants": dataclasses.asdict(stand.cue)}
    write_json(str(folder / "hidden_cue.json"), told)


def _draw(folder: Path, story: Story, progress: Progress) -> None:
    """The report and the recording."""
    from robot.learning.report import write_picture, write_recording, write_report

    progress("report and recording")
    write_report(folder / "report.html", story, f"The closed loop: {len(story.shots)} shots")
    write_picture(folder / "story.png", story)
    write_recording(folder / "story.rrd", story)


def figures(story: Story, course: Course, stand: EmulatedStand | None) -> dict[str, Any]:
    """What a series came to, as plain values (billiard-learn/1)."""
    return {
        "format": FORMAT, "seed": course.seed, "shots": len(story.shots), "every": course.every,
        "ended": story.ended, "blocks": _blocks(story, course.every),
        "refits": [dataclasses.asdict(refit) for refit in story.refits],
        "truth": _truth(story.refits[-1] if story.refits else None, course, stand),
    }  # fmt: skip


def _blocks(story: Story, every: int) -> list[dict[str, Any]]:
    """Figures of the shots from one refit to the next."""
    out = []
    for first in range(1, len(story.shots) + 1, every):
        shots = story.shots[first - 1 : first - 1 + every]
        last = shots[-1].number
        away = [s.away for s in shots if math.isfinite(s.away)]
        out.append({
            "first": first, "last": last, "learnt": shots[0].learnt, "miss_median_m": story.median_miss(first, last),
            "foreseen_median_m": story.median_spread(first, last), "scatter_median_m": story.floor(first, last),
            "potted": sum(s.potted is True for s in shots), "seen": sum(s.potted is not None for s in shots),
            "promised": sum(s.promised for s in shots if s.potted is not None),
            "from_wanted_median_m": float(np.median(away)) if away else math.nan,
        })  # fmt: skip
    return out


def _truth(last: Refit | None, course: Course, stand: EmulatedStand | None) -> dict[str, Any]:
    """What was begun with and what was found, beside what was hidden where it was emulated."""
    start = course.model.parameters()
    began = {n: float(v) for n, v in start.items()} | dataclasses.asdict(course.cueing_map.constants)
    hidden: dict[str, float] = {}
    if stand is not None:
        hidden = {n: float(v) for n, v in stand.model.parameters().items()} | dataclasses.asdict(stand.cue)
    found = {**last.values, **last.launcher} if last else {}
    units = {f.name: f.metadata["unit"] for f in dataclasses.fields(course.cueing_map.constants)}
    rows = []
    for name in dict.fromkeys((*hidden, *found)):
        value, sd = found.get(name, (math.nan, math.nan))
        if not name.startswith("native."):
            rows.append({
                "name": name, "unit": units[name] if name in units else course.model.meta(name)["unit"],
                "began": began.get(name), "value": value, "sd": sd, "hidden": hidden.get(name),
            })  # fmt: skip
    base = {e.name() for e in course.model.stack()}
    return {
        "effects": [e.name() for e in stand.model.stack() if e.name() not in base] if stand else None,
        "found": list(last.verdict) if last else [],
        "constants": rows,
    }


def text_of(told: dict[str, Any]) -> str:
    """What a person reads of them."""
    rows: list[tuple[str, ...]] = [
        ("shots", "learnt from", "miss mm", "foreseen mm", "scatter mm", "potted", "promised", "from wanted mm")
    ]
    for b in told["blocks"]:
        sizes = (b[f"{k}_median_m"] for k in ("miss", "foreseen", "scatter", "from_wanted"))
        miss, foreseen, scatter, away = (f"{1e3 * v:.0f}" if math.isfinite(v) else "-" for v in sizes)
        shots = f"{b['first']} to {b['last']}"
        potted = f"{b['potted']} of {b['seen']}"
        rows.append((shots, str(b["learnt"]), miss, foreseen, scatter, potted, f"{b['promised']:.1f}", away))
    parts = [
        table(rows),
        "medians: the cue ball from where it was told to stop, what the plans said of that, what the launcher alone "
        "scatters, the cue ball from its wanted place",
        "",
    ]
    for r in told["refits"]:
        found = ", ".join(r["verdict"]) or "no effect beyond the base"
        rest = f"; unexplained: {r['unexplained']}" if r["unexplained"] else ""
        parts.append(f"after {r['shots']} shots: {found}{rest} ({1e3 * r['rms']:.2f} mm rms, {r['seconds']:.0f} s)")
    if not told["refits"]:
        parts.append(f"no refit: that takes {told['every']} shots")
    return "\n".join([*parts, f"ended: {told['ended']}", "", *_truth_lines(told["truth"])])


def _truth_lines(truth: dict[str, Any]) -> list[str]:
    """The truth beside what was found."""
    emulated = truth["effects"] is not None
    rows: list[tuple[str, ...]] = [("constant", "unit", "began with", "learnt", "sd", *["really"] * emulated)]
    for c in truth["constants"]:
        values = (c["began"], c["value"], c["sd"], *[c["hidden"]] * emulated)
        rows.append((c["name"], c["unit"], *_numbers(*values)))
    lines = [f"found: {', '.join(truth['found']) or 'none'}", table(rows, 2)]
    if emulated:
        effects = ", ".join(truth["effects"]) or "none beyond those begun with"
        lines.insert(0, f"effects of the emulated table: {effects}")
    return lines


def _numbers(*values: float | None) -> Sequence[str]:
    return ["-" if v is None or not math.isfinite(v) else f"{v:.4g}" for v in values]
