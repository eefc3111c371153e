"""Least squares of many small problems that share constants; independent of billiards.

In: residuals as a function of unknowns (`Objective`), priors and bounds. Out: unknowns, and the shared constants with
their covariance (`Solution`).

    least_squares      many small problems at given constants: Levenberg-Marquardt, robust loss
    normal_equations   their information matrices and gradients
    journal            results of an interrupted run
    joint_fit          the shared constants: Schur complement, covariance
"""

from sysid.estimation.solver.joint_fit import Solution, StoppingRule, fit_joint
from sysid.estimation.solver.least_squares import Objective, Prior, fit_each

__all__ = ["Objective", "Prior", "Solution", "StoppingRule", "fit_each", "fit_joint"]
