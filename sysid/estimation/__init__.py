"""Constants of a model and initial states of shots from clips, with their uncertainty.

In: a clip set (sysid/clips) and a model. Out: a `FittedModel`: constants, initial states, covariance, discrepancy
rate, whether it converged, and the error on held-out clips. In the order of a fit:

    solver/           least squares of many small problems that share constants
    problem           unknowns and steps that all problems have in common
    shot_problem      whole shots: residuals from initial states and constants (residual_rows, compiled)
    segment_problem   segments between events, on open cloth; open_cloth fits them
    states/           initial states at given constants: where they begin, refined, searched
    sizes             length, width and diameter as constants, with the accuracy of a tape and a caliper as prior
    windows           shots cut into consecutive windows of one impact each
    chains/           multiple shooting: windows of long shots, with constants
    from_nothing      a model fitted to clips: windows first, then whole shots from there
    discrepancy       discrepancy of the model, which grows along a shot
    fitting           `fit(start)`: constants and initial states of whole shots together, from nearly right ones
    profile           standard deviations from profiles of a loss that is rough
    split             a clip set's training and held-out shots, without lost ones; fits evaluated on both
    clip_fit          a model fitted to a clip set: `sysid fit`
"""

from sysid.estimation.clip_fit import ClipFit, fit_clips
from sysid.estimation.fitted import FittedModel, HeldOut, Point, as_model
from sysid.estimation.fitting import fit, fit_held_out
from sysid.estimation.from_nothing import begin, fit_from_nothing
from sysid.estimation.shot_problem import ShotProblem
from sysid.estimation.split import Split, fit_on

__all__ = [
    "ClipFit", "FittedModel", "HeldOut", "Point", "ShotProblem", "Split", "as_model", "begin", "fit",
    "fit_clips", "fit_from_nothing", "fit_held_out", "fit_on",
]  # fmt: skip
