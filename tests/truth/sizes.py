"""Natural sizes of the hidden effects, and smaller ones.

A natural size is one that a real table, ball, cue or camera may well have, and with which the constants alone no
longer explain a clip set. Sources: Mathavan 2009, 2010 and Alciatore for what has been measured; where nothing has,
an engineer's estimate. Effects of the struck ball's start (`squirt`) show against the commands only.
"""

from __future__ import annotations

from typing import Final

from tests.truth.cloth import Constants

Sizes = dict[str, float]

NATURAL: Final[dict[str, Sizes]] = {
    "table_tilt": {"tilt_x": 0.0007, "tilt_y": -0.0016},
    "cloth_nap": {"nap": 0.22, "nap_phi": 0.0},
    "speed_drag": {"drag1": 0.035},
    "air_drag": {"drag2": 0.02},
    "spin_slide_coupling": {"contensou": 0.012},
    "side_curve": {"swerve": 0.0022},
    "cushion_restitution_speed": {"ec_v": 0.09},
    "ball_friction_speed": {"mubb": 0.01, "mubb_b": 0.108, "mubb_c": 1.088},
    "slide_friction_speed": {"mus_v": 0.2},
    "spin_decay_speed": {"spin_v": 0.4},
    "cushion_friction_speed": {"muc_v": 0.05},
    "ball_restitution_speed": {"ebb_v": 0.1},
    "cue_ball_mass": {"cue_mass": 1.02},
    "off_centre_ball": {"off_centre": 0.003},
    "cue_hop": {"hop": 0.06},
    "squirt": {"squirt": 4.0},
    "clock_scale": {"clock": 1.012},
    "lens_distortion": {"lens": 0.006},
    "camera_tilt": {"camera_tilt": 0.007},
    "image_scale": {"image_scale": 0.01},
    "rolling_shutter": {"shutter": 0.0066},
    "cushion_restitution_px": {"ec_px": -0.08},
    "cushion_restitution_mx": {"ec_mx": -0.08},
    "cushion_restitution_py": {"ec_py": -0.08},
    "cushion_restitution_my": {"ec_my": -0.08},
    "cushion_friction_px": {"muc_px": 0.06},
    "cushion_friction_mx": {"muc_mx": 0.06},
    "cushion_friction_py": {"muc_py": 0.06},
    "cushion_friction_my": {"muc_my": 0.06},
    "nose_height": {"nose": -0.13},
    "nose_height_px": {"nose_px": -0.06},
    "nose_height_mx": {"nose_mx": -0.06},
    "nose_height_py": {"nose_py": -0.06},
    "nose_height_my": {"nose_my": -0.06},
    "struck_ball_slide": {"cue_mus": 0.1},
    "struck_ball_roll": {"cue_mur": 0.1},
    "cloth_grain": {"ripple": 0.1, "ripple_phi": 0.3},
    "slide_curve": {"slide_swerve": 0.002},
    "lens_distortion_r4": {"lens4": 0.0012},
    "image_aspect": {"image_aspect": 0.005},
    "worn_patch": {"patch": 0.4},
    "cushion_compliance": {"compliance": 1.2},
    "soft_bed": {"bed": 0.3},
    "cushion_contact_time": {"contact": 0.004},
    "crowned_slate": {"crown": 0.0008},
    "drying_cloth": {"wear": 0.15},
    "ball_cling": {"cling": 1.0, "cling_share": 0.4},
    "soft_rail_ends": {"ends": 0.1},
    "slow_drag": {"slow": 0.3},
    "camera_shake": {"shake": 0.001},
}
KEPT: Final = {"nap_phi", "ripple_phi", "mubb", "mubb_c", "cling_share"}  # they say where or how, not how much
SCALES: Final = (1.0, 1 / 4, 1 / 16)


def scaled(effect: str, scale: float = 1.0) -> Sizes:
    """The constants of an effect at scale times its natural distance from where it vanishes."""
    off = Constants()._asdict()
    return {k: v if k in KEPT else off[k] + scale * (v - off[k]) for k, v in NATURAL[effect].items()}


def options(effect: str, scale: float = 1.0) -> list[str]:
    """The same, as options of `python -m tests.truth`."""
    return [word for k, v in scaled(effect, scale).items() for word in ("--constant", f"{k}={v!r}")]
