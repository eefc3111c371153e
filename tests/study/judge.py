"""Whether a result is right: the generator's constants as the models' parameters, and which place counts as right."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

from tests.study.plan import SIGMA
from tests.truth.cloth import GRAVITY, Constants

Truth = Mapping[str, float]
WITHIN: Final = 1.96  # standard deviations of a 95 % interval
RAILS: Final = ("px", "mx", "py", "my")

BASE: Final = {  # parameter of the models: constant of the generator
    "decoupled_cloth.slide": "mus",
    "decoupled_cloth.roll": "mur",
    "decoupled_cloth.spin": "spin",
    "ball_impact.restitution": "ebb",
    "ball_impact.friction": "mubb",
    "cushion_impact.restitution": "ec",
    "cushion_impact.friction": "muc",
}


@dataclass(frozen=True)
class Known:
    """A parameter of an effect, and its true value from the generator's constants."""

    key: str
    true: Callable[[Truth], float]
    off: float = 0.0


def _plain(constant: str) -> Callable[[Truth], float]:
    return lambda truth: truth[constant]


EFFECT_TRUTH: Final[dict[str, tuple[Known, ...]]] = {  # the first of each is the one whose size is judged
    "table_tilt": (Known("slope_y", _plain("tilt_y")), Known("slope_x", _plain("tilt_x"))),
    "cloth_nap": (Known("push", lambda t: t["nap"] * t["mur"] * GRAVITY * math.cos(t["nap_phi"])),),
    "speed_drag": (Known("rate", _plain("drag1")),),
    "air_drag": (Known("rate", _plain("drag2")),),
    "spin_slide_coupling": (Known("lever", _plain("contensou")),),
    "side_curve": (Known("rate", _plain("swerve")),),
    "cushion_restitution_speed": (Known("rate", _plain("ec_v")),),
    "ball_friction_speed": (Known("gain", _plain("mubb_b")), Known("decay", _plain("mubb_c"))),
    "slide_friction_speed": (Known("rate", _plain("mus_v")),),
    "spin_decay_speed": (Known("rate", _plain("spin_v")),),
    "cushion_friction_speed": (Known("rate", _plain("muc_v")),),
    "ball_restitution_speed": (Known("rate", _plain("ebb_v")),),
    "cue_ball_mass": (Known("factor", _plain("cue_mass"), 1.0),),
    "off_centre_ball": (Known("offset", _plain("off_centre")),),
    "cue_hop": (Known("time_per_speed", _plain("hop")),),
    "squirt": (Known("per_offset", _plain("squirt")),),
    "clock_scale": (Known("factor", _plain("clock"), 1.0),),
    "lens_distortion": (Known("barrel", _plain("lens")),),
    "camera_tilt": (Known("along_x", _plain("camera_tilt")), Known("along_y", lambda t: t["camera_tilt"] / 2)),
    "image_scale": (Known("stretch", _plain("image_scale")),),
    "rolling_shutter": (Known("delay", _plain("shutter")),),
    **{f"cushion_restitution_{rail}": (Known("change", _plain(f"ec_{rail}")),) for rail in RAILS},
    **{f"cushion_friction_{rail}": (Known("change", _plain(f"muc_{rail}")),) for rail in RAILS},
    "nose_height": (Known("change", _plain("nose")),),
    **{f"nose_height_{rail}": (Known("change", _plain(f"nose_{rail}")),) for rail in RAILS},
    "struck_ball_slide": (Known("change", _plain("cue_mus")),),
    "struck_ball_roll": (Known("change", _plain("cue_mur")),),
    "cloth_grain": (
        Known("along", lambda t: t["ripple"] * math.cos(2 * t["ripple_phi"])),
        Known("diagonal", lambda t: t["ripple"] * math.sin(2 * t["ripple_phi"])),
    ),
    "slide_curve": (Known("rate", _plain("slide_swerve")),),
    "lens_distortion_r4": (Known("fourth", _plain("lens4")),),
    "image_aspect": (Known("aspect", _plain("image_aspect")),),
    "worn_patch": (
        Known("roll", _plain("patch")),
        Known("slide", _plain("patch")),
        Known("x", _plain("patch_x")),
        Known("y", _plain("patch_y")),
        Known("radius", _plain("patch_r")),
    ),
    "cushion_compliance": (Known("ratio", _plain("compliance")),),
    "soft_bed": (Known("share", _plain("bed")),),
    "cushion_contact_time": (Known("time", _plain("contact")),),
}


@dataclass(frozen=True)
class Place:
    """What counts as the right place of a structure."""

    says: str
    holds: Callable[[Mapping[str, Any], Truth], bool]


def _where(told: Mapping[str, Any], *words: str) -> bool:
    """Whether place or kind, in words, hold one of these."""
    said = f"{told.get('where') or ''} | {told.get('what') or ''}"
    return any(w in said for w in words)


def _on(told: Mapping[str, Any], *words: str) -> bool:
    """Whether it is said to depend on one of these."""
    return any(w in said for said in told.get("depends_on") or () for w in words)


RIGHT: Final[dict[str, Place]] = {
    "crowned_slate": Place("on the cloth, by place", lambda u, t: _where(u, "cloth") and _on(u, "place")),
    "drying_cloth": Place(
        "on the cloth, by the order of the clips", lambda u, t: _where(u, "cloth") and _on(u, "order")
    ),
    "ball_cling": Place("collisions of balls", lambda u, t: _where(u, "collision", "between balls")),
    "soft_rail_ends": Place("cushions, by place", lambda u, t: _where(u, "cushion") and _on(u, "place")),
    "slow_drag": Place("rolling, by speed", lambda u, t: _where(u, "rolling") and _on(u, "speed")),
    "camera_shake": Place("the camera, or by time", lambda u, t: _where(u, "image", "camera") or _on(u, "time")),
}


@dataclass(frozen=True)
class Row:
    """A result, with the questions that the report asks of it."""

    data: Mapping[str, Any]

    @property
    def name(self) -> str:
        return str(self.data["name"])

    @property
    def group(self) -> str:
        return str(self.data["group"])

    @property
    def hidden(self) -> tuple[str, ...]:
        return tuple(self.data["hidden"])

    @property
    def variation(self) -> str:
        return str(self.data["variation"])

    @property
    def error(self) -> str:
        return str(self.data["error"] or "")

    @property
    def verdict(self) -> tuple[str, ...]:
        return tuple(self.data.get("verdict") or ())

    @property
    def unexplained(self) -> Mapping[str, Any] | None:
        return self.data.get("unexplained")

    @property
    def truth(self) -> Truth:
        """The generator's constants, those of effects that are off included."""
        return Constants()._asdict() | dict(self.data.get("truth") or {})

    @property
    def base_chi2(self) -> float:
        """Of the model without effects; nan where it is not known."""
        ladder = self.data.get("ladder") or []
        value = ladder[0]["chi2_reduced"] if ladder and not ladder[0]["effects"] else None
        return float("nan") if value is None else float(value)

    @property
    def exact(self) -> bool:
        """The verdict names what is hidden, and nothing else."""
        return self.all_named and not self.wrong

    @property
    def all_named(self) -> bool:
        """The verdict names all that is hidden."""
        return not self.error and set(self.hidden) <= set(self.verdict)

    @property
    def wrong(self) -> tuple[str, ...]:
        """Effects named that are not hidden."""
        return tuple(v for v in self.verdict if v not in self.hidden)

    @property
    def alarm(self) -> bool:
        """Something told of a set that hides nothing; a failed set counts too."""
        return bool(self.error or self.verdict or self.unexplained)

    @property
    def right_place(self) -> bool:
        """A structure is told, and rightly."""
        told = self.unexplained
        return bool(told) and not self.error and told is not None and RIGHT[self.hidden[0]].holds(told, self.truth)

    @property
    def sure(self) -> bool:
        """Its constants can be held against the truth: the model is the true one, its fit an optimum."""
        known = self.group != "outside" and not self.variation
        return known and self.exact and not self.unexplained and bool(self.data.get("converged"))

    def held_out(self) -> float:
        """Error of the last model on held-out clips over the true noise."""
        ladder = self.data.get("ladder") or []
        value = ladder[-1]["held_out_rms_m"] if ladder else None
        return float("nan") if value is None else float(value) / SIGMA

    def _off_by(self, name: str, true: float) -> float | None:
        """Distance from the truth in standard deviations; None without a standard deviation."""
        found = (self.data.get("parameters") or {}).get(name)
        if not found or found["value"] is None or not found["sd"]:
            return None
        return (float(found["value"]) - true) / float(found["sd"])

    def constants_off(self) -> list[float]:
        """Of the base's constants, in standard deviations."""
        found = [self._off_by(name, self.truth[constant]) for name, constant in BASE.items()]
        return [z for z in found if z is not None]

    def effects_off(self) -> list[float]:
        """Of all parameters of the hidden effects, in standard deviations."""
        every = [(f"{e}.{k.key}", k.true(self.truth)) for e in self.hidden for k in EFFECT_TRUTH[e]]
        return [z for z in (self._off_by(name, true) for name, true in every) if z is not None]

    def size_errors(self) -> dict[str, float]:
        """|found / true - 1| of the main parameter of every hidden effect."""
        errors = {}
        for effect in self.hidden:
            main = EFFECT_TRUTH[effect][0]
            found = (self.data.get("parameters") or {}).get(f"{effect}.{main.key}")
            if found and found["value"] is not None:
                errors[effect] = abs((float(found["value"]) - main.off) / (main.true(self.truth) - main.off) - 1)
        return errors

    def said(self) -> str:
        """The result in a line."""
        if self.error:
            return f"failed: {self.error}"
        parts = [", ".join(self.verdict) or "nothing"]
        if self.unexplained:
            depends = ", ".join(self.unexplained.get("depends_on") or ())
            parts.append(f"unexplained: {self.unexplained.get('where')} (depends on {depends})")
        parts.append(f"chi2 {self.base_chi2:.3f} to {float(self.data['ladder'][-1]['chi2_reduced'] or math.nan):.3f}")
        missing = [h for h in self.hidden if h not in self.verdict and h in EFFECT_TRUTH]
        parts += [self._best_of(h) for h in missing]
        if not self.data.get("converged"):
            parts.append("not converged")
        return "; ".join(parts)

    def _best_of(self, effect: str) -> str:
        """The best that a round said of an effect that was not named."""
        seen = [(c["delta_bic"], c) for r in self.data.get("rounds") or () for c in r if c["effect"] == effect]
        seen = [(d, c) for d, c in seen if d is not None]
        if not seen:
            return f"{effect} was not tried"
        delta, best = max(seen, key=lambda pair: (bool(pair[1]["fitted"]), pair[0]))
        how = "fitted" if best["fitted"] else "promised only"
        how += "" if best.get("converged", True) else ", not converged"
        return f"{effect} {how}: delta BIC {delta:.0f}"
