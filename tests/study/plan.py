"""The clip sets of the study: what each hides, how large it is, and the options of the generator that make it.

Every set has 12 clips of at most 4 s with 0.5 mm of noise and 1 % of the frames missing, unless its variation says
otherwise; those of long shots have 30, of carom from the stroke to rest. Seeds follow from what a set is, not from its
place in the plan, so that one more set changes no other.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import zip_longest
from typing import Final

from tests.truth.effects import EFFECTS, STRUCTURES
from tests.truth.sizes import options

CLIPS: Final = 12
SIGMA: Final = 0.0005  # [m]
GROUPS: Final = ("none", "natural", "quarter", "sixteenth", "two", "outside", "soiled", "long")
SCALES: Final = {"natural": 1.0, "quarter": 1 / 4, "sixteenth": 1 / 16}
TIMES: Final = {"natural": 3, "quarter": 3, "sixteenth": 2}  # sets per effect
OUTSIDE: Final = 2  # sets per structure
NONE: Final = 40
SOILED_NONE: Final = 12
SOILED_PAIRS: Final = 6  # the first of PAIRS
SOILED_CLIPS: Final = 16
SOILED_OPTIONS: Final = ("--soiled", "--fps", "60", "--outliers", "0.005", "--no-sigma")
LONG_CLIPS: Final = 30
LONG_OPTIONS: Final = (
    *("--no-cue", "--no-pockets", "--length", "2.84", "--width", "1.42", "--diameter", "0.0615", "--mass", "0.21"),
    *("--fps", "60"),
)
LONG: Final = (  # carom shots of 6 to 14 impacts
    *("table_tilt", "cloth_nap", "speed_drag", "spin_slide_coupling", "cushion_restitution_speed"),
    *("cushion_friction_speed", "cushion_restitution_py", "cushion_compliance", "camera_tilt", "ball_friction_speed"),
    *("air_drag", "side_curve", "nose_height", "slide_friction_speed", "lens_distortion", "rolling_shutter"),
    *("worn_patch", "soft_bed", "cushion_contact_time", "ball_restitution_speed"),
)
NEEDS_CUE: Final = "squirt"  # which shows against commands alone; other soiled sets have none
FIRST_SEED: Final = {group: 10000 * k for k, group in enumerate(GROUPS, 1)}
PER_EFFECT: Final = 10  # seeds kept for each


@dataclass(frozen=True)
class Mix:
    """Kinds of shots, repeated in this order, for effects that the usual ones hardly show.

    As one plays them who looks for such an effect.
    """

    name: str
    effects: tuple[str, ...]
    kinds: tuple[str, ...]


MIXES: Final = (
    Mix(
        "half cuts",  # what only meetings of balls show
        ("ball_friction_speed", "ball_restitution_speed", "cue_ball_mass", "ball_cling"),
        (*("cut", "roll", "cut_side", "cushion", "cut", "side"),
         *("cut_side", "draw", "cut", "cushion_side", "cut_side", "long")),
    ),
    Mix(
        "seven in twelve with side",  # what only a sidespin shows, and squirt only against a command
        ("squirt", "spin_decay_speed"),
        (*("cushion_side", "side", "swerve", "roll", "cushion", "cut_side"),
         *("side", "cut", "cushion_side", "draw", "spin", "side")),
    ),
)  # fmt: skip


def mix_of(hidden: Iterable[str]) -> Mix | None:
    """The mix for what is hidden; None for all kinds in turn."""
    return next((mix for mix in MIXES if set(hidden) & set(mix.effects)), None)


VARIATIONS: Final = {
    "no cue commands": ("--no-cue",),
    "unknown noise": ("--no-sigma",),
    "outliers 0.5 %, missing 5 %": ("--outliers", "0.005", "--missing", "0.05"),
}
PAIRS: Final = (
    ("table_tilt", "cushion_restitution_speed"),
    ("speed_drag", "ball_restitution_speed"),
    ("cloth_nap", "lens_distortion"),
    ("spin_slide_coupling", "squirt"),
    ("cushion_friction_speed", "ball_friction_speed"),
    ("cushion_restitution_speed", "camera_tilt"),
    ("cushion_restitution_speed", "cue_hop"),
    ("cue_ball_mass", "clock_scale"),
    ("ball_restitution_speed", "squirt"),
    ("rolling_shutter", "cue_hop"),
    ("table_tilt", "speed_drag"),
    ("side_curve", "image_scale"),
    ("cushion_restitution_px", "cushion_restitution_my"),
    ("cushion_restitution_py", "cushion_friction_mx"),
    ("worn_patch", "table_tilt"),
)
ELSEWHERE: Final[dict[str, tuple[str, ...]]] = {  # every second set of an effect has it at another place
    "worn_patch": ("--constant", "patch_x=-0.6", "--constant", "patch_y=0.3"),
}


@dataclass(frozen=True)
class Entry:
    """One set."""

    name: str
    group: str
    hidden: tuple[str, ...]  # effects, or one structure
    seed: int
    options: tuple[str, ...] = ()  # of the generator, for what is hidden
    variation: str = ""
    clips: int = CLIPS

    @property
    def kinds(self) -> tuple[str, ...]:
        """Kinds of shots, repeated in this order; empty for all that the generator has."""
        if self.group == "long":
            return ("carom",)
        mix = mix_of(self.hidden)
        return mix.kinds if mix else ()

    def words(self) -> tuple[str, ...]:
        """All options of `python -m tests.truth OUT`."""
        basis = ("--seed", str(self.seed), "--clips", str(self.clips), "--sigma", repr(SIGMA), "--missing", "0.01")
        kinds = ("--kind", ",".join(self.kinds)) if self.kinds else ()
        return (*basis, "--seconds", "4", *kinds, *self.options, *VARIATIONS.get(self.variation, ()),
                *self._circumstances())  # fmt: skip

    def _circumstances(self) -> tuple[str, ...]:
        if self.group == "long":
            return LONG_OPTIONS
        if self.group != "soiled":
            return ()
        return SOILED_OPTIONS if NEEDS_CUE in self.hidden else (*SOILED_OPTIONS, "--no-cue")


def _none() -> list[Entry]:
    names = list(VARIATIONS)
    found = []
    for k in range(NONE):
        variation = names[(k // 3) % len(names)] if k % 3 == 2 else ""
        found.append(Entry(f"none-{k + 1:02d}", "none", (), FIRST_SEED["none"] + k, (), variation))
    return found


def _single(group: str) -> list[Entry]:
    return [
        Entry(
            f"{group}-{effect}-{time + 1}", group, (effect,),
            FIRST_SEED[group] + PER_EFFECT * k + time,
            (*options(effect, SCALES[group]), *(ELSEWHERE.get(effect, ()) if time % 2 else ())),
        )
        for time in range(TIMES[group])
        for k, effect in enumerate(EFFECTS)
    ]  # fmt: skip


def _two() -> list[Entry]:
    return [
        Entry(f"two-{a}-{b}", "two", (a, b), FIRST_SEED["two"] + k, (*options(a), *options(b)))
        for k, (a, b) in enumerate(PAIRS)
    ]


def _outside() -> list[Entry]:
    return [
        Entry(
            f"outside-{name}-{time + 1}", "outside", (name,), FIRST_SEED["outside"] + PER_EFFECT * k + time,
            tuple(options(name)),
        )
        for time in range(OUTSIDE)
        for k, name in enumerate(STRUCTURES)
    ]  # fmt: skip


def _soiled() -> list[Entry]:
    """Nothing hidden, every effect once, some pairs; in turns, so that a part already gives a picture."""
    groups = ([()] * SOILED_NONE, [(effect,) for effect in EFFECTS], PAIRS[:SOILED_PAIRS])
    hidden = [one for turn in zip_longest(*groups) for one in turn if one is not None]
    return [
        Entry(
            f"soiled-{'-'.join(names) or 'none'}-{k + 1:02d}", "soiled", tuple(names), FIRST_SEED["soiled"] + k,
            tuple(word for name in names for word in options(name)), "soiled clips", SOILED_CLIPS,
        )
        for k, names in enumerate(hidden)
    ]  # fmt: skip


def _long() -> list[Entry]:
    return [
        Entry(f"long-{name}", "long", (name,), FIRST_SEED["long"] + k, tuple(options(name)), clips=LONG_CLIPS)
        for k, name in enumerate(LONG)
    ]


def plan() -> list[Entry]:
    """Every set, the groups in turn, so that a part of the study already gives a picture."""
    groups = [_none(), *(_single(g) for g in SCALES), _two(), _outside(), _soiled(), _long()]
    return [entry for turn in zip_longest(*groups) for entry in turn if entry is not None]
