"""Names of the hidden effects, and the constants of each; `cloth.Constants` says what every constant means.

`EFFECTS` are kinds that a catalogue of effects is expected to name, `STRUCTURES` such that none is: something is there
that no term describes. `CAMERA` are those of either that leave the motion as it is and change what is seen of it.
A new one: its constants in `cloth.Constants`, its name here, and its term: on the cloth in `cloth.py`, at impacts in
`physics.py`, in the camera in `camera.py`, between clips in `shots.clip_constants`; its natural size in `sizes.py`.
"""

from __future__ import annotations

from typing import Final

EFFECTS: Final[dict[str, tuple[str, ...]]] = {
    "table_tilt": ("tilt_x", "tilt_y"),
    "cloth_nap": ("nap", "nap_phi"),
    "speed_drag": ("drag1",),
    "air_drag": ("drag2",),
    "spin_slide_coupling": ("contensou",),
    "side_curve": ("swerve",),
    "cushion_restitution_speed": ("ec_v",),
    "ball_friction_speed": ("mubb_b", "mubb_c"),
    "slide_friction_speed": ("mus_v",),
    "spin_decay_speed": ("spin_v",),
    "cushion_friction_speed": ("muc_v",),
    "ball_restitution_speed": ("ebb_v",),
    "cue_ball_mass": ("cue_mass",),
    "off_centre_ball": ("off_centre",),
    "cue_hop": ("hop",),
    "squirt": ("squirt",),
    "clock_scale": ("clock",),
    "lens_distortion": ("lens",),
    "camera_tilt": ("camera_tilt",),
    "image_scale": ("image_scale",),
    "rolling_shutter": ("shutter",),
    "cushion_restitution_px": ("ec_px",),
    "cushion_restitution_mx": ("ec_mx",),
    "cushion_restitution_py": ("ec_py",),
    "cushion_restitution_my": ("ec_my",),
    "cushion_friction_px": ("muc_px",),
    "cushion_friction_mx": ("muc_mx",),
    "cushion_friction_py": ("muc_py",),
    "cushion_friction_my": ("muc_my",),
    "nose_height": ("nose",),
    "nose_height_px": ("nose_px",),
    "nose_height_mx": ("nose_mx",),
    "nose_height_py": ("nose_py",),
    "nose_height_my": ("nose_my",),
    "struck_ball_slide": ("cue_mus",),
    "struck_ball_roll": ("cue_mur",),
    "cloth_grain": ("ripple", "ripple_phi"),
    "slide_curve": ("slide_swerve",),
    "lens_distortion_r4": ("lens4",),
    "image_aspect": ("image_aspect",),
    "worn_patch": ("patch", "patch_x", "patch_y", "patch_r"),
    "cushion_compliance": ("compliance",),
    "soft_bed": ("bed",),
    "cushion_contact_time": ("contact",),
}
STRUCTURES: Final[dict[str, tuple[str, ...]]] = {
    "crowned_slate": ("crown",),
    "drying_cloth": ("wear",),
    "ball_cling": ("cling", "cling_share"),
    "soft_rail_ends": ("ends",),
    "slow_drag": ("slow", "slow_v"),
    "camera_shake": ("shake", "shake_hz"),
}
HIDDEN: Final = {**EFFECTS, **STRUCTURES}
CAMERA: Final = (
    "clock_scale",
    "lens_distortion",
    "lens_distortion_r4",
    "camera_tilt",
    "image_scale",
    "rolling_shutter",
    "image_aspect",
    "camera_shake",
)
