"""Mutants that change no observable where the model is valid: by name (mutants.Mutant.name), and why.

They are left out of the score, and counted beside it.
"""

LAST_AXIS = "the second axis of an array of two is its last"
CUE_IMPULSE = "models/analytic/cue_impulse.py"

EQUIVALENTS: dict[str, str] = {
    f"{CUE_IMPULSE} launch: -1  ->  1": LAST_AXIS,
    f"{CUE_IMPULSE} launch: -1  ->  1 (2)": LAST_AXIS,
    f"{CUE_IMPULSE} launch: -1  ->  1 (3)": LAST_AXIS,
    f"{CUE_IMPULSE} _with_slate: -1  ->  1": LAST_AXIS,
    f"{CUE_IMPULSE} _with_slate: -1  ->  1 (2)": LAST_AXIS,
    f"{CUE_IMPULSE} _with_slate: -1  ->  1 (3)": LAST_AXIS,
}
