"""`sysid measure CLIPS`: friction and restitution by direct methods, to start a fit from, and to check one by.

A fitted constant is compared at the speed of the measurement, where the model has an effect that changes it with
speed. The two share the tracks and so their noise; being differently made from them, they should still agree to some
two standard deviations, and where they do not, one of the two leaves something out.
"""

from __future__ import annotations

import argparse
import dataclasses
import io
import math
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from models.console import DONE, FOUND, Progress, Verb, check_outputs, table, write_json
from models.shot import GRAVITY
from sysid.cli.common import load, with_clips, with_effects

if TYPE_CHECKING:
    from models.model_file import Model
    from sysid.clips import ClipSet
    from sysid.direct.measured import Measured, Measurements

APART = 3.0  # standard deviations between measurement and fit from which that is said
INK, BAND, DOTS = "#1f2933", "#d9730d", "#2563a8"

# What a model's constant is at a speed, where an effect of the model changes it: value, rate, speed.
AT_SPEED: Mapping[str, tuple[str, Callable[[float, float, float], float]]] = {
    "decoupled_cloth.roll": ("speed_drag.rate", lambda c, k, v: c + k * v / GRAVITY),
    "decoupled_cloth.slide": ("slide_friction_speed.rate", lambda c, k, v: c * (1 - k * (v - 1))),
    "decoupled_cloth.spin": ("spin_decay_speed.rate", lambda c, k, v: c * (1 + k * v)),
    "ball_impact.restitution": ("ball_restitution_speed.rate", lambda c, k, v: c - k * (v - 1)),
    "cushion_impact.restitution": ("cushion_restitution_speed.rate", lambda c, k, v: c - k * (v - 1)),
}


def register(verb: Verb) -> None:
    """The verb with its options."""
    one = verb("measure", run, "friction and restitution by direct methods, without a simulation")
    with_clips(one)
    one.add_argument("--model", metavar="M.toml", help="a fitted model to hold against what is measured")
    one.add_argument("--out", metavar="M.toml", help="the base model with what is measured, for: sysid fit --model")
    one.add_argument("--json", metavar="FILE", help="the same figures as JSON, with every single value")
    one.add_argument("--report", metavar="FILE.png", help="every single value as a picture")
    with_effects(one)


def run(args: argparse.Namespace, progress: Progress) -> int:
    """Measure, print, write: 0 done, 1 if nothing could be measured."""
    from models.files import write_whole
    from models.model_file import write_model
    from sysid.clips.clock import stamp_scale
    from sysid.direct.measure import measure

    check_outputs(args.json, args.report, args.out)
    clip_set, model = load(args)
    found = measure(clip_set)
    progress.close()
    fitted = model if args.model else None
    print_measured(found, fitted)
    scale, sd = stamp_scale(clip_set)
    if abs(scale - 1) > APART * sd:
        print(f"the stamps keep {scale:.4f} of the nominal frame interval: if they are wrong, so is every deceleration")
    if args.json:
        write_json(args.json, to_json(found, fitted))
    if all(one.value is None for one in found.all):
        print("\nnothing could be measured" + (f"; {args.out} is not written" if args.out else ""))
        return FOUND
    if args.report:
        write_whole(args.report, picture(found))
        print(f"report: {args.report}")
    if args.out:
        write_model(starting_model(clip_set, found), args.out)
        print(f"model: {args.out} (go on with: sysid fit {args.clips} --model {args.out} --out FITTED.toml)")
    return DONE


def against(one: Measured, model: Model) -> tuple[float, float] | None:
    """A model's value of a constant, at the speed of the measurement, and how many sd the measurement is above it."""
    values = model.parameters()
    if one.value is None or one.sd is None or one.kind.name not in values:
        return None
    value = float(values[one.kind.name])
    rate, law = AT_SPEED.get(one.kind.name, ("", None))
    if law and rate in values and math.isfinite(one.speed):
        value = law(value, float(values[rate]), one.speed)
    known = model.estimates.get(one.kind.name)
    own = known.sd if known and math.isfinite(known.sd) else 0.0
    return value, (one.value - value) / math.hypot(one.sd, own)


def starting_model(clip_set: ClipSet, found: Measurements) -> Model:
    """The base model with what was measured, within the bounds of each constant; the rest at its default."""
    from models.model_file import Estimate, full_model

    model = full_model(clip_set.table, clip_set.ball)
    values, estimates = {}, {}
    for one in found.all:
        if one.value is not None and one.sd is not None and one.kind.name in model.parameters():
            low, high = model.meta(one.kind.name)["bounds"]
            values[one.kind.name] = min(max(one.value, low), high)
            estimates[one.kind.name] = Estimate(one.sd, f"sysid measure, {counted(one)}")
    return dataclasses.replace(model.with_values(values), estimates=estimates)


def counted(one: Measured) -> str:
    """From how many segments or events."""
    return f"{one.count} {one.kind.of.removesuffix('s') if one.count == 1 else one.kind.of}"


def print_measured(found: Measurements, model: Model | None = None) -> None:
    """A table, and below it what to know of each constant."""
    spikes = f", {found.spikes} samples set aside" if found.spikes else ""
    print(f"{found.clips} clips, noise {found.noise * 1e3:.3f} mm{spikes}\n")
    head = ["constant", "value", "sd", *(["model", "apart"] if model else []), "unit", "from", "at m/s", "chi2"]
    rows, notes, how = [head], [], ["how"]
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
            cells += [one.kind.unit, counted(one), *own]
        rows.append([one.kind.name, *cells])
        how.append(one.kind.method)
        notes += [f"{one.kind.name}: {text}" for text in one.warnings]
        if held and abs(held[1]) > APART:
            notes.append(f"{one.kind.name}: measurement and model are {abs(held[1]):.1f} sd apart")
    lines = table(rows).splitlines()
    wide = max(map(len, lines))
    print("\n".join(f"{line.ljust(wide)}  {text}" for line, text in zip(lines, how, strict=True)))
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
    """Every single value with its error against speed, and the figure made of them: PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    shown = [one for one in found.all if one.singles and one.value is not None and one.sd is not None]
    high = max((len(shown) + 1) // 2, 1)
    figure = Figure(figsize=(10.6, 0.6 + 2.4 * high), layout="constrained")
    for k, one in enumerate(shown):
        value, sd = one.value or math.nan, one.sd or math.nan
        ax = figure.add_subplot(high, 2, k + 1)
        speed = [s.speed if math.isfinite(s.speed) else one.speed for s in one.singles]
        y, bar = ([getattr(s, n) / one.kind.divisor for s in one.singles] for n in ("value", "sd"))
        ax.errorbar(speed, y, bar, fmt=".", color=DOTS, elinewidth=0.7)
        ax.axhspan(value - sd, value + sd, color=BAND, alpha=0.35, linewidth=0)
        ax.axhline(value, color=BAND, linewidth=1)
        ax.set_title(f"{one.kind.name}: {value:.5g} ± {sd:.2g}, {counted(one)}", loc="left", fontsize=9, color=INK)
        ax.set_xlabel("m/s", fontsize=8)
        ax.set_ylabel(f"[{one.kind.unit}]", fontsize=8)
        ax.tick_params(labelsize=8)
    canvas, data = FigureCanvasAgg(figure), io.BytesIO()
    canvas.print_png(data, metadata={"Software": None})
    return data.getvalue()
