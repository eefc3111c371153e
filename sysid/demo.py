"""The shipped example, start to end: compare, see where the model fails, add what is missing, watch the error fall."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

from models.errors import BadInput
from models.model_file import Model, effect_class, write_model
from sysid.clips import read_clip_set
from sysid.compare import compare, in_words
from sysid.comparison import Comparison
from sysid.fit import fit

EXAMPLE = Path(__file__).with_name("example")
STEPS = (
    ("native MuJoCo contact", ()),
    ("+ decoupled_cloth", ("decoupled_cloth",)),
    ("+ ball_impact, cushion_impact", ("ball_impact", "cushion_impact")),
)


def run(out: Path, progress: Callable[[str], None]) -> int:
    """Fit and compare three models of rising completeness; write model, result, report and recording into `out`."""
    from sysid.cli import print_constants, table, write_json
    from sysid.report import Rung, write_report
    from sysid.review import write_rrd

    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput(f"{out}: cannot be made ({error.strerror}); choose another folder") from error
    clip_set = read_clip_set(EXAMPLE)
    model = Model(clip_set.table, clip_set.ball)
    found: list[tuple[str, Comparison]] = []
    ladder: list[Rung] = []
    print(f"The example: {len(clip_set.clips)} shots on a snooker table, filmed at {clip_set.fps:g} frames a second.\n")
    for label, names in STEPS:
        for name in names:
            model = model.add(effect_class(name)())
        fitted = fit(clip_set, model, lambda line, label=label: progress(f"{label}: {line}"), command="sysid demo")  # type: ignore[misc]
        comparison = compare(clip_set, fitted.model, lambda line, label=label: progress(f"{label}: {line}"))  # type: ignore[misc]
        model = dataclasses.replace(fitted.model)
        found.append((label, comparison))
        ladder.append(_rung(label, comparison))
        getattr(progress, "close", lambda: None)()
        print(f"{label}: {comparison.summary()['rms_median_m'] * 1e3:.2f} mm median over the clips")
        for line in in_words(comparison):
            print(f"  {line}")
        print(flush=True)
    rows = [("model", "all clips mm", "held out mm", "chi2", "segments / noise")]
    for rung, (_, c) in zip(ladder, found, strict=True):
        rows.append(
            (rung.label, f"{rung.rms_m * 1e3:.2f}", f"{rung.held_out_rms_m * 1e3:.2f}", f"{rung.chi2_reduced:.2f}",
             f"{c.summary()['segment_ratio_median']:.2f}")
        )  # fmt: skip
    noise = found[-1][1].noise_m
    print(table(rows))
    print(f"noise of the tracker: {noise * 1e3:.2f} mm an axis, {noise * 2**0.5 * 1e3:.2f} mm in distance\n")
    print_constants(model)
    write_model(model, out / "model.toml")
    write_json(str(out / "result.json"), {**found[-1][1].to_json(), "ladder": [vars(r) for r in ladder]})
    notes = [f"{label}: {in_words(c)[0]}" for label, c in found]
    write_report(out / "report.html", "The shipped example", found, ladder=ladder, notes=notes, model=model)
    write_rrd(out / "review.rrd", found[-1][1])
    print(f"\nwritten to {out}: model.toml, result.json, report.html (open in a browser), review.rrd (rerun {out}/review.rrd)")
    return 0


def _rung(label: str, comparison: Comparison) -> object:
    import numpy as np

    from sysid.report import Rung

    fitted = [c for c in comparison.clips if not c.held_out]
    held = [c for c in comparison.clips if c.held_out]

    def pooled(rows: list) -> float:  # type: ignore[type-arg]
        return float(np.sqrt(np.mean([r.rms_m**2 for r in rows]))) if rows else float("nan")

    chi2 = float(np.mean([c.chi2_reduced for c in comparison.clips]))
    return Rung(label, pooled(fitted), pooled(held), chi2, "")
