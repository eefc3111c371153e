"""The shipped example, start to end: compare, see where the model fails, add what is missing, watch the error fall."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from models.errors import BadInput
from models.model_file import Model, effect_class, full_model, write_model
from sysid.clips import read_clip_set
from sysid.compare import compare, in_words
from sysid.comparison import ClipRow, Comparison
from sysid.fit import fit
from sysid.output import Progress, print_constants, table, write_json
from sysid.report import Rung, write_report
from sysid.review import write_rrd

EXAMPLE = Path(__file__).with_name("example")
IMPACTS = ("ball_impact", "cushion_impact")
STACKS = (
    ("native MuJoCo contact", ()),
    ("+ decoupled_cloth", ("decoupled_cloth",)),
    ("+ ball_impact, cushion_impact", ("decoupled_cloth", *IMPACTS)),
)
NATIVE = {"decoupled_cloth": "", "ball_impact": "ball_", "cushion_impact": "cushion_"}  # terms of the same meaning


def run(out: Path, progress: Progress) -> int:
    """Fit and compare three models of rising completeness; write model, result, report and recording into `out`."""
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{out}: cannot be made ({error.strerror}); choose another folder") from error
    clip_set = read_clip_set(EXAMPLE)
    print(f"The example: {len(clip_set.clips)} shots on a snooker table, filmed at {clip_set.fps:g} frames a second.")
    fitted = fit(clip_set, full_model(clip_set.table, clip_set.ball), progress, command="sysid demo")
    full = fitted.model
    last = compare(clip_set, full, progress)
    print("Each model has the constants that fit the last one, so that only the contact differs.\n", flush=True)
    found: list[tuple[str, Comparison]] = []
    for label, names in STACKS:
        shown = stack(full, names)
        one = compare(clip_set, shown, _named(progress, label), start=last.own) if len(names) < 3 else last
        found.append((label, one))
        progress.close()
        print(f"{label}: {pooled(one.clips) * 1e3:.2f} mm rms over all clips")
        for line in in_words(one):
            print(f"  {line}")
        print(flush=True)
    model = full
    ladder = [_rung(label, one) for label, one in found]
    free = [not track.events for track in last.tracks]
    rows: list[tuple[str, ...]] = [("model", "open cloth mm", "with impacts mm", "held out mm", "chi2")]
    for rung, (_, one) in zip(ladder, found, strict=True):
        parts = [[c for c, f in zip(one.clips, free, strict=True) if f is kind] for kind in (True, False)]
        numbers = [pooled(parts[0]), pooled(parts[1]), rung.held_out_rms_m]
        rows.append((rung.label, *(f"{n * 1e3:.2f}" for n in numbers), f"{rung.chi2_reduced:.2f}"))
    noise = found[-1][1].noise_m
    print(table(rows))
    print(f"noise of the tracker: {noise * 1e3:.2f} mm an axis, {noise * 2**0.5 * 1e3:.2f} mm in distance\n")
    print_constants(model)
    write_model(model, out / "model.toml")
    write_json(str(out / "result.json"), {**found[-1][1].to_json(), "ladder": [vars(r) for r in ladder]})
    notes = [f"{label}: {in_words(c)[0]}" for label, c in found]
    write_report(out / "report.html", "The shipped example", found, ladder=ladder, notes=notes, model=model)
    write_rrd(out / "review.rrd", found[-1][1])
    print(f"\nwritten to {out}: model.toml, result.json, report.html, review.rrd")
    print(f"open {out / 'report.html'} in a browser, and the shots with: .venv/bin/rerun {out / 'review.rrd'}")
    return 0


def stack(full: Model, names: tuple[str, ...]) -> Model:
    """The model with some of its effects, MuJoCo's own terms with the constants of those left out, or its defaults."""
    defaults = {f"native.{key}": full.meta(f"native.{key}")["off"] for key in ("ball_grip", "cushion_grip")}
    native = defaults | {
        f"native.{prefix}{key}": value
        for effect, prefix in NATIVE.items()
        for key in effect_class(effect).parameters()
        if f"native.{prefix}{key}" in {f"native.{k}" for k in full.native.parameters()}
        for value in [full.parameters()[f"{effect}.{key}"]]
    }
    kept = tuple(e for e in full.effects if e.name() in names)
    return dataclasses.replace(full.with_values(native), effects=kept)


def _named(progress: Callable[[str], None], label: str) -> Callable[[str], None]:
    return lambda line: progress(f"{label}: {line}")


def pooled(rows: Sequence[ClipRow]) -> float:
    """Root of the mean squared error over clips [m]; NaN without any."""
    return float(np.sqrt(np.mean([r.rms_m**2 for r in rows]))) if rows else float("nan")


def _rung(label: str, comparison: Comparison) -> Rung:
    fitted = [c for c in comparison.clips if not c.held_out]
    held = [c for c in comparison.clips if c.held_out]
    chi2 = float(np.mean([c.chi2_reduced for c in comparison.clips]))
    return Rung(label, pooled(fitted), pooled(held), chi2, "")
