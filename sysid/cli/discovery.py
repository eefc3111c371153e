"""The verbs that look for what is missing: `sysid diagnose` and `sysid discover`."""

from __future__ import annotations

import argparse
import hashlib
import pickle
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from models.console import DONE, FOUND, Progress, Verb, check_outputs, print_constants, table, write_json
from models.errors import BadInput
from models.files import write_whole
from sysid.cli.common import load, with_clips, with_effects, with_engine

if TYPE_CHECKING:
    from models.model_file import Model
    from sysid.clips import ClipSet
    from sysid.selection.discover import Discovery

CHECKPOINT = "unfinished.pickle"


def register(verb: Verb) -> None:
    """These verbs with their options."""
    one = verb("diagnose", diagnose, "which effect is missing: ranked, or none, or something else")
    with_clips(one)
    one.add_argument("--model", metavar="M.toml", help="model file to start from (default: the base)")
    with_engine(one)
    with_effects(one)
    one.add_argument("--json", metavar="FILE", help="the same figures as JSON")
    one.add_argument("--report", metavar="FILE.html", help="the same with pictures")
    one = verb("discover", discover, "fit, diagnose and add until nothing more is to be explained")
    with_clips(one)
    one.add_argument("--model", metavar="M.toml", help="model file to start from (default: the base)")
    with_engine(one)
    one.add_argument("--out", metavar="DIR", required=True, help="where model, result, report and recording go")
    with_effects(one)
    one = verb("demo", demo, "the shipped example, start to end")
    one.add_argument("--out", metavar="DIR", default="out/demo", help="where results go (default: out/demo)")


def demo(args: argparse.Namespace, progress: Progress) -> int:
    """The shipped example, start to end."""
    from sysid.cli.demo import run

    return run(Path(args.out), progress)


def diagnose(args: argparse.Namespace, progress: Progress) -> int:
    """Which effect is missing."""
    from sysid.clips.pieces import whole
    from sysid.estimation.split import begin
    from sysid.report.findings import (
        cut_line,
        round_rows,
        shot_lines,
        verdict_lines,
    )
    from sysid.report.result_json import judgement_json
    from sysid.selection.discover import best_next
    from sysid.selection.formula import describe
    from sysid.selection.judge import judge
    from sysid.selection.remainder import remainder

    check_outputs(args.json, args.report)
    clip_set, model = load(args)
    parts, base = begin(clip_set, model)
    judged = judge(parts, base)
    told: Mapping[str, Any] | None = None
    if judged.structure is not None and judged.trial is not None:
        told = describe(judged.structure, judged.trial.fitted, judged.trial.evidence)
    elif judged.name is None:
        told = remainder(judged.round.base)
    shot = best_next(parts, base, (judged.round,), (judged.name,) if judged.name else ())
    progress.close()
    seen = judged.round
    held = len({whole(c.file) for c in parts.held_out.clips}) if parts.held_out else 0
    print(f"{len(clip_set.clips)} clips, {held} of them held out, noise {parts.noise * 1e3:.3f} mm")
    if seen.runs:
        print(f"whole shots miss by {base.rms * 1e3:.3f} mm, so {seen.runs} runs between impacts are looked at")
    print(f"base: {seen.base.rms * 1e3:.3f} mm rms, held out {seen.base.held_rms * 1e3:.3f} mm\n")
    print(table(round_rows(seen)))
    lines = [*([cut_line(parts)] if parts.cut else []), *verdict_lines(judged, told)]
    print("\n" + "\n".join([*lines, *shot_lines(shot)]))
    if args.json:
        write_json(args.json, judgement_json(parts, judged, told, shot))
    if args.report:
        from sysid.report.html import write_report
        from sysid.residuals.compare import compare

        whole_shots = base if seen.runs else seen.base
        own = parts.states_of(whole_shots, [c.file for c in clip_set.clips])
        comparison = compare(clip_set, whole_shots.model, progress, start=own)
        progress.close()
        notes = [*lines, *shot_lines(shot)]
        write_report(args.report, "What is missing", [("base", comparison)], notes=notes, rounds=(seen,))
        print(f"report: {args.report}")
    return DONE if seen.base.converged else FOUND


def discover(args: argparse.Namespace, progress: Progress) -> int:
    """The whole loop into a folder."""
    from sysid.report.findings import discovery_lines, print_ladder, round_rows
    from sysid.report.outcome import write_outcome
    from sysid.report.text import engines_line
    from sysid.selection.discover import discover as run

    clip_set, model = load(args)
    out = Path(args.out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{out}: cannot be made ({error.strerror}); choose another folder") from error
    began = time.monotonic()
    mark = _fingerprint(clip_set, model)
    resumed, spent = _resume(out, mark)
    if resumed is not None:
        print(f"going on from {out / CHECKPOINT}: {', '.join(resumed.verdict) or 'the base is fitted'}", flush=True)

    def save(found: Discovery) -> None:
        state = pickle.dumps((mark, spent + time.monotonic() - began, found))
        write_whole(out / CHECKPOINT, state)
        progress.close()
        if found.rounds:
            print(table(round_rows(found.rounds[-1])) + "\n")
        last = found.last
        name = ", ".join(found.verdict) or "base"
        print(f"{name}: {last.rms * 1e3:.3f} mm rms, held out {last.held_rms * 1e3:.3f} mm\n", flush=True)

    try:
        found = run(clip_set, model, save, resumed)
    except KeyboardInterrupt:
        progress.close()
        if (out / CHECKPOINT).exists():
            print(f"interrupted; {out / CHECKPOINT} is kept: the same command goes on from there", flush=True)
        raise
    progress.close()
    print(table(round_rows(found.rounds[-1])) + "\n")
    print_ladder(found)
    print("\n" + "\n".join(discovery_lines(found)) + "\n")
    elapsed = spent + time.monotonic() - began
    outcome = write_outcome(out, clip_set, found, progress, elapsed, f"sysid discover {args.clips}")
    print_constants(outcome.model)
    print("\n" + engines_line(outcome))
    print(f"\nwritten to {out}: model.toml, result.json, report.html, review.rrd")
    (out / CHECKPOINT).unlink(missing_ok=True)
    return DONE if found.last.converged else FOUND


def _fingerprint(clip_set: ClipSet, model: Model) -> str:
    """Of what a saved state depends on: the clips, the model to start from, the catalogue and this program."""
    from models.model_file import catalogue

    digest = hashlib.sha256()
    root = Path(__file__).resolve().parents[2]
    for path in sorted([*root.glob("models/**/*.py"), *root.glob("sysid/**/*.py")]):
        digest.update(path.read_bytes())
    digest.update(repr((clip_set.table, clip_set.ball, clip_set.fps, clip_set.sigma, sorted(catalogue()))).encode())
    digest.update(repr([(e.name(), sorted(vars(e).items())) for e in model.effects]).encode())
    for clip in clip_set.clips:
        digest.update(repr((clip.file, clip.struck, clip.cue)).encode())
        for name, seen in clip.balls.items():
            digest.update(name.encode() + seen.time.tobytes() + seen.xy.tobytes() + seen.theta.tobytes())
    return digest.hexdigest()


def _resume(out: Path, mark: str) -> tuple[Discovery | None, float]:
    """What an interrupted run of the same command left, and how long it took; nothing if it was another."""
    path = out / CHECKPOINT
    if not path.exists():
        return None, 0.0
    try:
        known, spent, found = pickle.loads(path.read_bytes())
    except Exception:  # noqa: BLE001 (whatever a damaged or foreign file raises, the work starts afresh)
        return None, 0.0
    return (found, float(spent)) if known == mark else (None, 0.0)
