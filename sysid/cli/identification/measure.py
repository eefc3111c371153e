"""`sysid measure CLIPS`: friction and restitution by direct methods, to start a fit or to check one.

A fitted constant is compared at the speed of the measurement, where the model has an effect that changes it with
speed. Both use the same tracks and thus the same noise, but different methods: they should agree to about two standard
deviations. Where they do not, one of the two leaves something out.
"""

from __future__ import annotations

import dataclasses
import io
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from models.commands.console import Progress, Status, as_called, table, write_json
from models.commands.options import effects_option, json_option, out_option, output_option
from models.messages import counted
from sysid.cli.common import Start, clips_argument, model_option

if TYPE_CHECKING:
    from models.model_file import Model
    from sysid.clips import ClipSet
    from sysid.direct.measured import Measured, Measurements

MIN_DISAGREEMENT_SD = 3.0  # smaller differences are not reported [standard deviations]
TEXT_COLOUR, MEAN_COLOUR, SINGLES_COLOUR = "#1f2933", "#d9730d", "#2563a8"


@click.command()
@clips_argument
@model_option
@out_option("M.toml", "Write the base model with the measured constants, for: sysid fit --model.", required=False)
@json_option
@output_option("report", "FILE.png", "Draw every single value.")
@effects_option()
@click.pass_obj
def measure(
    progress: Progress, clips: Path, model_file: Path | None, out: Path | None, json_file: Path | None,
    report_file: Path | None,
) -> int:  # fmt: skip
    """Measure friction and restitution directly, without a simulation.

    Reads the clip set CLIPS, and with --model a fitted model to compare with. Prints each constant with its standard
    deviation. Status 1 if nothing could be measured.

    Example: sysid measure CLIPS --out start.toml
    """
    from models.files import write_whole
    from models.model_file import write_model
    from sysid.clips.tracker.clock import stamp_scale
    from sysid.direct.measure import measure as measure_clips

    clip_set, model = Start(clips, (model_file,) if model_file else ()).load()
    found = measure_clips(clip_set)
    progress.close()
    fitted = model if model_file else None
    print_measured(found, fitted)
    scale, sd = stamp_scale(clip_set)
    if abs(scale - 1) > MIN_DISAGREEMENT_SD * sd:
        print(
            f"the time stamps are {scale:.4f} nominal frame intervals apart: if they are wrong, so is every "
            "deceleration"
        )
    if json_file:
        write_json(json_file, to_json(found, fitted))
    if all(one.value is None for one in found.all):
        print("\nnothing could be measured" + (f"; {out} is not written" if out else ""))
        return Status.FINDING
    if report_file:
        write_whole(report_file, picture(found))
        print(f"report: {report_file}")
    if out:
        write_model(starting_model(clip_set, found), out)
        command = as_called(f"sysid fit {clips} --model {out} --out FITTED.toml")
        print(f"model: {out} (continue with: {command})")
    return Status.DONE


def law_at_speed(constant: str) -> tuple[str, Callable[[float, float, float], float] | None]:
    """The parameter of the effect that changes a constant with speed, and the law: constant(value, rate, speed)."""
    from models.shot import GRAVITY

    return {
        "decoupled_cloth.roll": ("speed_drag.rate", lambda c, k, v: c + k * v / GRAVITY),
        "decoupled_cloth.slide": ("slide_friction_speed.rate", lambda c, k, v: c * (1 - k * (v - 1))),
        "decoupled_cloth.spin": ("spin_decay_speed.rate", lambda c, k, v: c * (1 + k * v)),
        "ball_impact.restitution": ("ball_restitution_speed.rate", lambda c, k, v: c - k * (v - 1)),
        "cushion_impact.restitution": ("cushion_restitution_speed.rate", lambda c, k, v: c - k * (v - 1)),
    }.get(constant, ("", None))


def against(one: Measured, model: Model) -> tuple[float, float] | None:
    """A model's constant at the measurement's speed, and the measurement's excess over it [standard deviations]."""
    values = model.parameters()
    if one.value is None or one.sd is None or one.kind.name not in values:
        return None
    value = float(values[one.kind.name])
    rate, law = law_at_speed(one.kind.name)
    if law and rate in values and math.isfinite(one.speed):
        value = law(value, float(values[rate]), one.speed)
    known = model.estimates.get(one.kind.name)
    model_sd = known.sd if known and math.isfinite(known.sd) else 0.0
    return value, (one.value - value) / math.hypot(one.sd, model_sd)


def starting_model(clip_set: ClipSet, found: Measurements) -> Model:
    """The base model with the measured constants, each within its bounds; the others at their defaults."""
    from models.model_file import Estimate, full_model

    model = full_model(clip_set.table, clip_set.ball)
    values, estimates = {}, {}
    for one in found.all:
        if one.value is not None and one.sd is not None and one.kind.name in model.parameters():
            low, high = model.meta(one.kind.name)["bounds"]
            values[one.kind.name] = min(max(one.value, low), high)
            estimates[one.kind.name] = Estimate(one.sd, f"sysid measure, {measured_on(one)}")
    return dataclasses.replace(model.with_values(values), estimates=estimates)


def measured_on(one: Measured) -> str:
    """The number of segments or events, in words."""
    return counted(one.count, one.kind.of.removesuffix("s"))


def print_measured(found: Measurements, model: Model | None = None) -> None:
    """Print a table of the constants, followed by their warnings."""
    spikes = f", {found.spikes} outlying samples left out" if found.spikes else ""
    print(f"{counted(found.clips, 'clip')}, noise {found.noise * 1e3:.3f} mm{spikes}\n")
    head = ["constant", "value", "sd", *(["model", "apart"] if model else []), "unit", "from", "at m/s", "chi2"]
    rows, notes, methods = [head], [], ["method"]
    for one in found.all:
        held = against(one, model) if model else None
        if one.value is None or one.sd is None:
            cells = ["-", "-", *(["-", "-"] if model else []), one.kind.unit, "-", "-", "-"]
        else:
            digits = max(0, 1 - math.floor(math.log10(one.sd)))
            cells = [f"{one.value:.{digits}f}", f"{one.sd:.{digits}f}"]
            if model:
                cells += [f"{held[0]:.{digits}f}", f"{held[1]:+.1f} sd"] if held else ["-", "-"]
            own = (f"{k:.{n}f}" if math.isfinite(k) else "-" for k, n in ((one.speed, 2), (one.chi2, 1)))
            cells += [one.kind.unit, measured_on(one), *own]
        rows.append([one.kind.name, *cells])
        methods.append(one.kind.method)
        notes += [f"{one.kind.name}: {text}" for text in one.warnings]
        if held and abs(held[1]) > MIN_DISAGREEMENT_SD:
            notes.append(f"{one.kind.name}: measurement and model are {abs(held[1]):.1f} sd apart")
    lines = table(rows).splitlines()
    wide = max(map(len, lines))
    print("\n".join(f"{line.ljust(wide)}  {text}" for line, text in zip(lines, methods, strict=True)))
    if notes:
        print("\n" + "\n".join(notes))


def to_json(found: Measurements, model: Model | None = None) -> dict[str, Any]:
    """Format billiard-measurement/1."""
    measured = []
    for one in found.all:
        about = {k: getattr(one.kind, k) for k in ("name", "unit", "of", "method", "slope_unit")}
        own = {k: v for k, v in vars(one).items() if k not in ("kind", "singles")}
        scale = {"value": 1 / one.kind.divisor, "sd": 1 / one.kind.divisor}
        singles = [{k: scale.get(k, 1) * v for k, v in vars(s).items()} for s in one.singles]
        held = against(one, model) if model else None
        check = {"model": held[0], "sds_apart": held[1]} if held else {}
        measured.append(about | own | check | {"singles": singles})
    head = {"format": "billiard-measurement/1", "clips": found.clips, "noise_m": found.noise}
    return head | {"samples_set_aside": found.spikes, "measured": measured}


def picture(found: Measurements) -> bytes:
    """Write a PNG of the single values with their errors against speed, and of their mean."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    shown = [one for one in found.all if one.singles and one.value is not None and one.sd is not None]
    rows = max((len(shown) + 1) // 2, 1)
    figure = Figure(figsize=(10.6, 0.6 + 2.4 * rows), layout="constrained")
    for k, one in enumerate(shown):
        value, sd = one.value or math.nan, one.sd or math.nan
        ax = figure.add_subplot(rows, 2, k + 1)
        speed = [s.speed if math.isfinite(s.speed) else one.speed for s in one.singles]
        y, bar = ([getattr(s, n) / one.kind.divisor for s in one.singles] for n in ("value", "sd"))
        ax.errorbar(speed, y, bar, fmt=".", color=SINGLES_COLOUR, elinewidth=0.7)
        ax.axhspan(value - sd, value + sd, color=MEAN_COLOUR, alpha=0.35, linewidth=0)
        ax.axhline(value, color=MEAN_COLOUR, linewidth=1)
        ax.set_title(
            f"{one.kind.name}: {value:.5g} ± {sd:.2g}, {measured_on(one)}", loc="left", fontsize=9, color=TEXT_COLOUR
        )
        ax.set_xlabel("m/s", fontsize=8)
        ax.set_ylabel(f"[{one.kind.unit}]", fontsize=8)
        ax.tick_params(labelsize=8)
    canvas, data = FigureCanvasAgg(figure), io.BytesIO()
    canvas.print_png(data, metadata={"Software": None})
    return data.getvalue()
