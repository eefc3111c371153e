"""Judges of fitted constants: each beside its typical values, and what it means for the table, the balls or the camera.

In: a constant as a `Finding`. Out: its `HealthLine`; none for a constant without a typical range or meaning.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

from models.model_file import Model
from models.report.numbers import value_with_sd
from models.shot import GRAVITY, NOSE_COSINE, NOSE_HEIGHT, NOSE_SINE, RAIL_NAMES
from models.table.sizes import BALL_DIAMETER, TABLE_LENGTH, TABLE_WIDTH
from sysid.estimation.sizes import SIZE_SDS
from sysid.report.finding import INTERVAL_SDS, NOT_DETERMINED, Finding, HealthLine
from sysid.report.typical import (
    AT_FAST_SLIP,
    AT_LOW_SPEED,
    AT_ONE_METRE_PER_SECOND,
    BALL_HEIGHT_STRETCH,
    FAST_CLOTH_ROLL,
    FITTERS_SLOPE_RAD,
    TYPICAL_RANGES,
    TypicalRange,
)

SIZE_NAMES: Final = {
    TABLE_LENGTH: ("table, length from nose to nose", "length"),
    TABLE_WIDTH: ("table, width from nose to nose", "width"),
    BALL_DIAMETER: ("balls, diameter", "diameter"),
}
DETERMINED_SHARE = 0.5  # of the standard deviation with which a size was stated: a smaller one is the clips'
RAIL_OF: Final = dict(zip(("px", "mx", "py", "my"), RAIL_NAMES, strict=True))


def judged(name: str, found: Finding) -> HealthLine | None:
    """The line on a constant by its name; None where it has neither a typical range nor a meaning."""
    effect, key = name.split(".")
    if name in TYPICAL_RANGES:
        return _in_range(name, TYPICAL_RANGES[name], found)
    kind, _, letter = effect.rpartition("_")
    if letter in RAIL_OF and kind in RAIL_JUDGES and key == "change":
        return RAIL_JUDGES[kind](RAIL_OF[letter], found)
    if name in SIZE_NAMES:
        return _size(name, found)
    return JUDGES[name](found) if name in JUDGES else None


def _size(name: str, found: Finding) -> HealthLine:
    """A size of table or ball beside what was stated."""
    stated, (what, key) = found.model.meta(name)["default"], SIZE_NAMES[name]
    if name != BALL_DIAMETER:
        found = Finding(found.value + _met_nearer(found.model), found.sd, found.model)
    off = Finding(found.value - stated, found.sd, found.model)
    determined = found.sd < DETERMINED_SHARE * SIZE_SDS[name] * stated
    verdict = "as stated"
    if not determined:
        verdict = NOT_DETERMINED
    elif off.significant:
        more = f"{abs(off.value) * 1e3:.1f} mm {'more' if off.value > 0 else 'less'}"
        verdict = f"{more} than stated: measure it again, and correct {key} in clips.toml"
        if name != BALL_DIAMETER:
            share = 100 * abs(off.value) / stated
            verdict += f"; if the stated {key} is right, the camera's scale is off by {share:.2g} %: calibrate it again"
    measured = _measured(found.value, found.sd, "m")
    source = "clips.toml, within the error of a tape or a caliper"
    return HealthLine(what, measured, f"{stated:g} m", source, verdict, determined, "stated")


def _met_nearer(model: Model) -> float:
    """By how much noses at the played height, 7R/5, are closer together than at the height found [m]."""
    sine = NOSE_SINE + float(model.parameters().get("nose_height.change", 0.0))
    return (math.sqrt(1.0 - sine**2) - NOSE_COSINE) * model.as_played().ball.diameter


def _noses(found: Finding) -> HealthLine:
    """Height of the noses, over the radius and above the slate."""
    height, radius = NOSE_HEIGHT + found.value, found.model.as_played().ball.radius
    return HealthLine(
        "cushions, height of the noses", _measured(height, found.sd, "R"),
        "1.4 R snooker, 1.25 to 1.29 R pool, 1.17 to 1.20 R carom", "Mathavan 2010; WPA; UMB",
        f"{height * radius * 1e3:.1f} mm above the slate" if found.significant else NOT_DETERMINED, found.significant,
    )  # fmt: skip


def _nose(rail: str, found: Finding) -> HealthLine:
    """One nose beside the others."""
    off = abs(found.value) * found.model.as_played().ball.radius * 1e3
    verdict = f"cushion {rail} stands {off:.1f} mm {'higher' if found.value > 0 else 'lower'} than the others"
    return HealthLine(
        f"cushion {rail}, height of its nose", _measured(found.value, found.sd, "R"), "0", "all cushions alike",
        f"{verdict}: check its bolts and shims" if found.significant else NOT_DETERMINED, found.significant,
    )  # fmt: skip


def _in_range(name: str, usual: TypicalRange, found: Finding) -> HealthLine:
    """A constant with a published range."""
    scale = usual.shown_scale
    measured = _measured(found.value * scale, found.sd * scale, usual.shown_unit)
    typical = f"{usual.low * scale:.3g} to {usual.high * scale:.3g} {usual.shown_unit}".rstrip()
    what = usual.what + _where_it_holds(name, found.model)
    if not found.narrower_than(usual.high - usual.low):
        return HealthLine(what, measured, typical, usual.source, NOT_DETERMINED, False)
    low, high = found.value - INTERVAL_SDS * found.sd, found.value + INTERVAL_SDS * found.sd
    if high < usual.low:
        verdict = usual.below
    elif low > usual.high:
        verdict = usual.above
    else:
        verdict = usual.within
    if name == "decoupled_cloth.roll":
        verdict = "fast" if usual.low <= low and high < FAST_CLOTH_ROLL else verdict
        verdict += f": a ball that rolls at 1 m/s runs {0.5 / (GRAVITY * found.value):.1f} m"
    return HealthLine(what, measured, typical, usual.source, verdict, True)


def _where_it_holds(name: str, model: Model) -> str:
    """The speed at which a constant holds, where an effect of the model changes it with speed."""
    acting = {effect.name() for effect in model.stack()}
    kinds = ((AT_ONE_METRE_PER_SECOND, " at 1 m/s"), (AT_FAST_SLIP, " at fast slip"), (AT_LOW_SPEED, " at low speed"))
    return next((words for effects, words in kinds if effects.get(name) in acting), "")


def _measured(value: float, sd: float, unit: str) -> str:
    return f"{value_with_sd(value, sd)} {unit}".rstrip()


def _slope(axis: int) -> Callable[[Finding], HealthLine]:
    """Judge of the slope along an axis; positive runs downhill towards +x, +y, so that this end is the low one."""

    def judge(found: Finding) -> HealthLine:
        letter, size = "xy"[axis], (found.model.table.length, found.model.table.width)[axis]
        what, limit = f"slope along {letter}", FITTERS_SLOPE_RAD
        measured = _measured(abs(found.value) * 1e3, found.sd * 1e3, "mm/m")
        determined = found.narrower_than(2 * limit)
        towards = f"{'+' if found.value > 0 else '-'}{letter}"
        clear, brief, remedy = abs(found.value) - INTERVAL_SDS * found.sd > limit, "", ""
        if not determined:
            verdict = NOT_DETERMINED
        elif clear:
            lift = f"{abs(found.value) * size * 1e3:.1f} mm"
            verdict = f"downhill towards {towards}: raise that end by {lift}"
            low = f"{towards} {('end', 'side')[axis]}"
            brief, remedy = f"{low} {lift} low", f"raise the {low} by {lift}"
            if axis == 0:
                verdict += "; nap along the table looks alike, so check with a level first"
                brief += " (nap along the table looks alike: check with a level)"
        elif abs(found.value) + INTERVAL_SDS * found.sd < limit:
            verdict = "level, as fitters aim at"
        else:
            verdict = f"at the limit, downhill towards {towards}: check with a level"
        return HealthLine(
            what, measured, "up to 0.4 mm/m", "fitters' aim; players notice 1.7 mm/m (AzBilliards)", verdict,
            determined, brief=brief, remedy=remedy,
        )  # fmt: skip

    return judge


def _cushion(rail: str, found: Finding) -> HealthLine:
    """One cushion beside the others."""
    what, measured = f"cushion {rail}, change of restitution", _measured(found.value, found.sd, "")
    verdict = NOT_DETERMINED
    if found.significant:
        share = 100 * found.value / found.model.parameters()["cushion_impact.restitution"]
        more = "more" if found.value > 0 else "less"
        verdict = f"cushion {rail} returns {abs(share):.2g} % {more} of a ball's speed than the others"
        verdict += "" if found.value > 0 else ": look for loose bolts, old rubber or a gap behind it"
    return HealthLine(
        what, measured, "0", "all cushions alike, as Mathavan 2010 takes them", verdict, found.significant
    )


def _nap(found: Finding) -> HealthLine:
    towards = "+x" if found.value > 0 else "-x"
    verdict = (
        f"pushes balls towards {towards}, as a slope would: check with a level" if found.significant else NOT_DETERMINED
    )
    measured = _measured(found.value * 1e3, found.sd * 1e3, "mm/s^2")
    return HealthLine("cloth, push of the nap", measured, "0 to 3 mm/s^2", "estimate", verdict, found.significant)


def _worn(found: Finding) -> HealthLine:
    names = [f"worn_patch.{key}" for key in ("x", "y", "radius")]
    x, y, radius = (found.model.parameters()[name] for name in names)
    placed = all(name in found.model.estimates and math.isfinite(found.model.estimates[name].sd) for name in names)
    verdict = NOT_DETERMINED
    if found.significant and placed:
        more = "more" if found.value > 0 else "less"
        verdict = (
            f"within {radius:.2f} m of x = {x:.2f}, y = {y:.2f} m rolling balls slow down "
            f"{abs(100 * found.value):.2g} % {more} than elsewhere: look for wear, dirt or a seam there"
        )
    measured = _measured(100 * found.value, 100 * found.sd, "%")
    determined = found.significant and placed
    return HealthLine("cloth, a patch of its own friction", measured, "0", "an even cloth", verdict, determined)


def _clock(found: Finding) -> HealthLine:
    off = Finding(found.value - 1.0, found.sd, found.model)
    way = "too long" if off.value > 0 else "too short"
    verdict = f"time stamps are {abs(100 * off.value):.2g} % {way}: divide t by {found.value:.4f}, or correct fps"
    return HealthLine(
        "camera, clock", _measured(found.value, found.sd, ""), "0.995 to 1.005",
        "frame rates are off by 0.01 to 0.5 %", verdict if off.significant else NOT_DETERMINED, off.significant,
    )  # fmt: skip


def _lens(found: Finding) -> HealthLine:
    table = found.model.table
    corner = math.hypot(table.length, table.width) / 2
    way = "inwards" if found.value > 0 else "outwards"
    shift = abs(found.value) * corner**3 * 1e3
    verdict = f"the lens shifts a ball in a corner {shift:.0f} mm {way}: calibrate it (sysid calibrate --board)"
    measured = _measured(100 * found.value * corner**2, 100 * found.sd * corner**2, "% at the corner")
    return HealthLine(
        "camera, lens", measured, "0.5 to 2 % uncalibrated, 0 calibrated", "estimate",
        verdict if found.significant else NOT_DETERMINED,
        found.significant,
    )  # fmt: skip


def _scale(found: Finding) -> HealthLine:
    way = "large" if found.value > 0 else "small"
    verdict = f"positions are {abs(100 * found.value):.2g} % too {way}: "
    if found.value - INTERVAL_SDS * found.sd > 0 and found.value < BALL_HEIGHT_STRETCH + INTERVAL_SDS * found.sd:
        verdict += "calibrate at the height of the balls' centres, not of the cloth (sysid calibrate --diameter)"
    else:
        verdict += "check the table's length and width, and calibrate again"
    return HealthLine(
        "camera, scale", _measured(100 * found.value, 100 * found.sd, "%"), "0, up to 1.3 % if calibrated on the cloth",
        "parallax of the balls' height, R / (H - R)", verdict if found.significant else NOT_DETERMINED,
        found.significant,
    )  # fmt: skip


def _camera_tilt(axis: int) -> Callable[[Finding], HealthLine]:
    def judge(found: Finding) -> HealthLine:
        smaller = "+" if found.value > 0 else "-"
        verdict = f"the picture is too small towards {smaller}{'xy'[axis]}: calibrate the camera again"
        return HealthLine(
            f"camera, gradient of the scale along {'xy'[axis]}", _measured(100 * found.value, 100 * found.sd, "%/m"),
            "0; 0.7 %/m for 1 degree at 2.5 m", "pinhole", verdict if found.significant else NOT_DETERMINED,
            found.significant,
        )  # fmt: skip

    return judge


def _shutter(found: Finding) -> HealthLine:
    readout = abs(found.value) * found.model.table.width * 1e3
    end = "+y" if found.value > 0 else "-y"
    verdict = (
        f"rows towards {end} are read late, {readout:.1f} ms over the table's width: keep this effect in the model"
    )
    return HealthLine(
        "camera, rolling shutter", _measured(found.value * 1e3, found.sd * 1e3, "ms/m"), "0; 3.3 ms/m for a telephone",
        "estimate: 5 ms over 1.52 m", verdict if found.significant else NOT_DETERMINED,
        found.significant,
    )  # fmt: skip


RAIL_JUDGES: Final = {"cushion_restitution": _cushion, "nose_height": _nose}
JUDGES: Final[dict[str, Callable[[Finding], HealthLine]]] = {
    "table_tilt.slope_x": _slope(0),
    "table_tilt.slope_y": _slope(1),
    "cloth_nap.push": _nap,
    "clock_scale.factor": _clock,
    "lens_distortion.barrel": _lens,
    "nose_height.change": _noses,
    "worn_patch.roll": _worn,
    "image_scale.stretch": _scale,
    "camera_tilt.along_x": _camera_tilt(0),
    "camera_tilt.along_y": _camera_tilt(1),
    "rolling_shutter.delay": _shutter,
}
