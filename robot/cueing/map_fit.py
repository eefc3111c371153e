"""Fit of the cueing map's constants, and of the launcher's scatter, to a campaign.

In: the shots of a campaign, priors. Out: a `CueingMap`, and the `Execution` errors with their standard deviations.

Constants: least squares of ball speed and squirt together, each shot whitened by the covariance of the launcher's
execution errors and of the camera (an error of position affects both; the error that repeats share counts once), with a
soft L1 loss, then with a quadratic loss without shots beyond five standard deviations. Wide normal priors replace
missing information. The covariance of the constants is (J'J)^-1, times the reduced chi squared if that exceeds 1.

Scatter: shots of one stroke scatter about their mean with covariance camera + G diag(variances) G', G the derivatives
of the map by speed, side, height and aim; the variances maximise the Wishart likelihood of all strokes' scatter, and
their uncertainty follows from its Fisher information. Left out: errors that are correlated from shot to shot.
"""

from __future__ import annotations

import dataclasses
from collections import Counter, defaultdict
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares, minimize

from models.analytic.cue_impulse import CONSTANT_NAMES, Constants, Geometry, ball_speed_and_squirt
from models.errors import BadInput
from models.table.snooker import SNOOKER_BALL
from planner.launcher.cueing_map import CueingMap
from planner.launcher.execution import MAX_SD, Execution
from robot.cueing.campaign import CueShot

Array = NDArray[np.float64]
PRIOR_SD = {
    "tip_restitution": 0.2, "cue_mass": 0.3, "end_mass": 0.006, "slate_friction": 0.1, "contact_time": 4e-4,
    "side_zero": 2e-3, "height_zero": 2e-3, "aim_zero": 0.03,
}  # fmt: skip # wide against the information of a campaign
MIN_SHOTS = 16  # fewest shots for eight constants
OUTLIER_SDS = 5.0  # distance, in standard deviations of both figures together, beyond which a shot is left out
MIN_REPEATS = 40  # fewest repeats (shots minus strokes) for the launcher's scatter
PLACE_STEP_M = 1e-4  # finite-difference step of positions


def columns(shots: Sequence[CueShot]) -> tuple[Array, Array, Array, Array, Array]:
    """Cue speed [m/s], side, height [m], measured (n, 2) and the variance of each by the camera's noise (n, 2)."""
    rows = np.array([(s.cue_speed, 1e-3 * s.x0_mm, 1e-3 * s.y0_mm) for s in shots]).reshape(-1, 3)
    measured = np.array([(s.ball_speed, s.squirt_rad) for s in shots]).reshape(-1, 2)
    camera = np.array([(s.ball_speed_sd, s.squirt_sd) for s in shots]).reshape(-1, 2) ** 2
    return rows[:, 0], rows[:, 1], rows[:, 2], measured, camera


def _shared(shots: Sequence[CueShot]) -> Array:
    """Variance of the error that repeats share (n, 2), times their number, since together they count as one shot."""
    count = Counter((s.string, s.x0_mm, s.y0_mm) for s in shots)
    one = np.array([(s.ball_speed_unsure, s.squirt_unsure) for s in shots]).reshape(-1, 2) ** 2
    return np.asarray(one * np.array([[count[s.string, s.x0_mm, s.y0_mm]] for s in shots], float))


def fit_map(
    shots: Sequence[CueShot],
    geometry: Geometry | None = None,
    *,
    start: Constants | None = None,
    execution: Execution | None = None,
    fewest: int = MIN_SHOTS,
) -> CueingMap:
    """Fit the constants to a campaign.

    Args:
        shots: of the campaign; miscues are left out.
        geometry: of tip, cue and ball; by default the paper's.
        start: centre of the priors.
        execution: the launcher's scatter; by default from the repeats if there are enough, else the planner's.
        fewest: smallest number of shots; with fewer than constants the priors determine the rest.

    Raises:
        BadInput: too few shots, or all at one position.
    """
    geometry, start = geometry or Geometry(SNOOKER_BALL), start or Constants()
    good = [s for s in shots if not s.miscue]
    places = {(s.x0_mm, s.y0_mm) for s in good}
    if len(good) < fewest or len({x for x, _ in places}) < 3 or len({y for _, y in places}) < 3:
        raise BadInput(
            f"{len(good)} shots at {len(places)} positions are too few for a cueing map; "
            f"strike {fewest} or more, at 3 or more sides and heights"
        )
    constants, noise = start, execution or Execution()
    for again in (False, True):
        if again and execution is None:
            if count_repeats(good) < MIN_REPEATS:
                break
            noise, _ = scatter(good, constants, geometry)
        constants, covariance, chi2, left_out = _solve(good, geometry, start, constants, noise)
        if execution is not None:
            break
    return CueingMap(constants, geometry, covariance, noise, len(good) - left_out, left_out, chi2)


def _solve(
    shots: Sequence[CueShot], geometry: Geometry, centre: Constants, begin: Constants, noise: Execution
) -> tuple[Constants, Array, float, int]:
    """Constants, their covariance, the reduced chi squared, and the number of outlying shots."""
    speed, side, height, measured, camera = columns(shots)
    before = np.array([getattr(centre, name) for name in CONSTANT_NAMES])
    width = np.array([PRIOR_SD[name] for name in CONSTANT_NAMES])
    fields = {f.name: f.metadata["bounds"] for f in dataclasses.fields(Constants)}
    low, high = (np.array([fields[name][k] for name in CONSTANT_NAMES]) for k in (0, 1))
    root = np.linalg.cholesky(_covariances(speed, side, height, camera + _shared(shots), begin, geometry, noise))
    keep = np.ones(len(shots), bool)

    def whitened(p: Array) -> Array:
        predicted = np.stack(ball_speed_and_squirt(to_constants(p), geometry, speed, side, height), axis=-1)
        return np.asarray(np.linalg.solve(root, (measured - predicted)[..., None])[..., 0])

    def residual(p: Array) -> Array:
        return np.concatenate([whitened(p)[keep].ravel(), (p - before) / width])

    p = np.clip([getattr(begin, name) for name in CONSTANT_NAMES], low, high)
    for loss in ("soft_l1", "linear"):
        found = least_squares(residual, p, bounds=(low, high), x_scale=width, loss=loss, f_scale=2.0, max_nfev=80)
        if not found.success:
            raise BadInput(f"the cueing map does not fit {len(shots)} shots; check them for wrong units or signs")
        p = found.x
        if loss == "soft_l1":
            keep = np.linalg.norm(whitened(p), axis=-1) < OUTLIER_SDS
    free = max(2 * int(np.sum(keep)) - len(p), 1)
    chi2 = float(np.sum(whitened(p)[keep] ** 2)) / free
    return to_constants(p), np.linalg.inv(found.jac.T @ found.jac) * max(chi2, 1.0), chi2, int(np.sum(~keep))


def to_constants(p: Array) -> Constants:
    """Constants from their values in the order of NAMES."""
    return Constants(**{name: float(v) for name, v in zip(CONSTANT_NAMES, p, strict=True)})


def _derivatives(speed: Array, side: Array, height: Array, constants: Constants, geometry: Geometry) -> Array:
    """Derivatives of ball speed and squirt by fraction of speed, aim, and the contact's side and height: (n, 2, 4)."""
    out = np.zeros((len(speed), 2, 4))
    for k, (x, y) in enumerate(((PLACE_STEP_M, 0.0), (0.0, PLACE_STEP_M)), 2):
        ahead = ball_speed_and_squirt(constants, geometry, speed, side + x, height + y)
        behind = ball_speed_and_squirt(constants, geometry, speed, side - x, height - y)
        out[:, :, k] = np.stack([a - b for a, b in zip(ahead, behind, strict=True)], axis=-1) / (2 * PLACE_STEP_M)
    out[:, :, 2:] /= geometry.lever  # Execution refers to the contact, the stage moves the axis
    out[:, 0, 0] = ball_speed_and_squirt(constants, geometry, speed, side, height)[0]
    out[:, 1, 1] = 1.0
    return out


def _covariances(
    speed: Array,
    side: Array,
    height: Array,
    variances: Array,
    constants: Constants,
    geometry: Geometry,
    noise: Execution,
) -> Array:
    """Covariance of measured ball speed and squirt: (n, 2, 2)."""
    g = _derivatives(speed, side, height, constants, geometry)
    sizes = np.array([noise.speed_sd, noise.azimuth_sd, noise.side_sd, noise.height_sd])
    return np.asarray((g * sizes**2) @ np.swapaxes(g, 1, 2) + variances[:, :, None] * np.eye(2))


def _strokes(shots: Sequence[CueShot]) -> list[list[CueShot]]:
    """Shots grouped by commanded stroke, for repeated strokes only."""
    groups: defaultdict[tuple[int, float, float], list[CueShot]] = defaultdict(list)
    for s in shots:
        groups[s.string, s.x0_mm, s.y0_mm].append(s)
    return [group for group in groups.values() if len(group) > 1]


def count_repeats(shots: Sequence[CueShot]) -> int:
    """The number of shots that repeat another."""
    return sum(len(group) - 1 for group in _strokes(shots))


def scatter(shots: Sequence[CueShot], constants: Constants, geometry: Geometry) -> tuple[Execution, Execution]:
    """The launcher's errors from repeated strokes, with their standard deviations.

    Raises:
        BadInput: too few strokes were repeated.
    """
    groups = _strokes(shots)
    if count_repeats(shots) < MIN_REPEATS:
        raise BadInput(
            f"{count_repeats(shots)} repeats are too few for the launcher's scatter; give {MIN_REPEATS} or more"
        )
    first = [group[0] for group in groups]
    speed, side, height, _, _ = columns(first)
    g = _derivatives(speed, side, height, constants, geometry)
    camera = np.array([np.mean(columns(group)[4], axis=0) for group in groups])[:, :, None] * np.eye(2)
    spread = np.array([np.cov(columns(group)[3], rowvar=False) for group in groups])
    free = np.array([len(group) - 1.0 for group in groups])
    unit = np.array([0.01, 0.001, 3e-4, 3e-4])

    def total(p: Array) -> Array:
        return np.asarray((g * (p * unit) ** 2) @ np.swapaxes(g, 1, 2) + camera)

    def unlikely(p: Array) -> float:
        s = total(p)
        return float(
            0.5 * np.sum(free * (np.linalg.slogdet(s)[1] + np.trace(np.linalg.solve(s, spread), axis1=1, axis2=2)))
        )

    most = np.array([MAX_SD[k] for k in ("speed_sd", "azimuth_sd", "side_sd", "height_sd")]) / unit
    found = minimize(unlikely, np.ones(4), bounds=[(1e-3, m) for m in most], method="L-BFGS-B")
    size = found.x * unit
    slopes = np.einsum("nik,njk->nkij", g, g)  # of the covariance by each variance
    each = np.linalg.solve(total(found.x)[:, None], slopes)
    fisher = 0.5 * np.einsum("n,nkij,nlji->kl", free, each, each)
    scale = np.sqrt(np.diag(fisher))  # balances variances in m^2 and in 1 for the inverse
    variance_sd = np.sqrt(np.diag(np.linalg.inv(fisher / np.outer(scale, scale)))) / scale
    sds = np.sqrt(size**2 + variance_sd) - size  # sd / (2 size) if it is small, and finite at 0
    return Execution(*map(float, size)), Execution(*map(float, sds))
