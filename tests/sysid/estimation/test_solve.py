"""Least squares over many problems: known answers, known covariance, outliers, what the data do not determine."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import lsq_linear

from sysid.estimation.solver.joint_fit import SharedConstants, Solution, StoppingRule, covariance, fit_joint
from sysid.estimation.solver.least_squares import (
    Evaluate,
    Objective,
    Prior,
    differences,
    fit_each,
    loss,
    solve_each,
    weights,
)
from sysid.estimation.solver.normal_equations import from_columns, from_derivatives, projected

Array = NDArray[np.float64]
Index = NDArray[np.int64]
WIDE = np.array([-1e3, 1e3])
TRUE = np.array([0.7, -1.3])
PROBLEMS, SAMPLES = 30, 12


def free(p: int) -> Prior:
    """No prior knowledge of p unknowns."""
    return Prior(np.zeros(p), np.full(p, np.inf))


def joint(
    evaluate: Evaluate, x: Array, c: Array, robust: float = np.inf, iterations: int = 30, **more: Array
) -> Solution:
    """`fit_joint` with small steps, and no prior and no bounds unless given."""
    p, q = x.shape[1], c.size
    bounds = more.get("bounds", np.tile(WIDE, (q, 1)))
    steps, steps_c = np.full(p, 1e-5), np.full(q, 1e-5)
    objective = Objective(evaluate, steps, free(p), robust)
    return fit_joint(objective, x, c, SharedConstants(steps_c, bounds), StoppingRule(iterations))


def linear(rng: np.random.Generator, noise: float = 1.0) -> tuple[Evaluate, Array, Array, Array]:
    """Residuals A x + B c - y with unit noise; the design (A, B) and the initial states that y was made with."""
    a, b = rng.normal(size=(PROBLEMS, SAMPLES, 2)), rng.normal(size=(PROBLEMS, SAMPLES, 2))
    own = rng.normal(size=(PROBLEMS, 2))
    y = np.einsum("nmp,np->nm", a, own) + b @ TRUE + noise * rng.normal(size=(PROBLEMS, SAMPLES))

    def evaluate(x: Array, c: Array, which: Index) -> Array:
        return np.einsum("nmp,np->nm", a[which], x) + np.einsum("nmq,nq->nm", b[which], c) - y[which]

    return evaluate, a, b, own


def schur(a: Array, b: Array) -> Array:
    """Covariance of the constants of a linear model with unit noise, initial states eliminated."""
    information = np.zeros((b.shape[2], b.shape[2]))
    for one, other in zip(a, b, strict=True):
        beside = np.eye(len(one)) - one @ np.linalg.pinv(one)
        information += other.T @ beside @ other
    return np.asarray(np.linalg.inv(information))


def decays(rates: Array, own: Array, noise: Array | float = 0.0) -> tuple[Evaluate, Array]:
    """Each problem sees its own amplitude decay at a rate that all share, and rise to an offset that all share."""
    t = np.linspace(0, 4, 25)

    def signal(x: Array, c: Array) -> Array:
        return x * np.exp(-c[:, :1] * t) + c[:, 1:]

    y = signal(own, np.tile(rates, (len(own), 1))) + noise

    def evaluate(x: Array, c: Array, which: Index) -> Array:
        return (signal(x, c) - y[which]) / 0.01

    return evaluate, t


def test_linear_problems_are_solved_exactly() -> None:
    evaluate, a, b, own = linear(np.random.default_rng(1), noise=0.0)
    found = joint(evaluate, np.zeros((PROBLEMS, 2)), np.zeros(2))
    assert found.converged
    np.testing.assert_allclose(found.constants, TRUE, atol=1e-6)
    np.testing.assert_allclose(found.initial_states, own, atol=1e-5)
    # Without noise no problem pulls, so that the sandwich is nothing and the inverse information is left.
    np.testing.assert_allclose(found.covariance, schur(a, b), rtol=1e-3)


def test_the_answer_is_that_of_one_large_least_squares_problem() -> None:
    evaluate, a, b, _ = linear(np.random.default_rng(2))
    rows = np.arange(PROBLEMS)
    y = -evaluate(np.zeros((PROBLEMS, 2)), np.zeros((PROBLEMS, 2)), rows)
    design = np.zeros((PROBLEMS, SAMPLES, 2 * PROBLEMS + 2))
    for k in rows:
        design[k, :, 2 * k : 2 * k + 2] = a[k]
    design[..., -2:] = b
    answer = np.linalg.lstsq(design.reshape(-1, design.shape[2]), y.ravel(), rcond=None)[0]
    found = joint(evaluate, np.zeros((PROBLEMS, 2)), np.zeros(2))
    sd = np.sqrt(np.diag(schur(a, b)))
    assert np.all(np.abs(found.constants - answer[-2:]) < 0.02 * sd)
    assert np.all(np.sqrt(np.diag(found.covariance)) >= 0.999 * sd)


def test_intervals_cover_the_truth() -> None:
    """Of 95 % intervals over 200 seeds; the larger of two estimates of the sd covers a little more."""
    inside = np.zeros(2)
    for seed in range(200):
        evaluate, *_ = linear(np.random.default_rng(seed))
        found = joint(evaluate, np.zeros((PROBLEMS, 2)), np.zeros(2))
        assert found.converged
        inside += np.abs(found.constants - TRUE) < 1.96 * np.sqrt(np.diag(found.covariance))
    assert np.all(inside >= 0.88 * 200) and np.all(inside <= 0.99 * 200), inside


def test_a_nonlinear_problem_finds_the_truth_and_its_covariance() -> None:
    own, rates = np.array([[1.0], [2.0], [0.5], [1.5]]), np.array([0.8, 0.2])
    evaluate, t = decays(rates, own)
    found = joint(evaluate, np.ones((4, 1)), np.array([0.3, 0.0]))
    assert found.converged
    np.testing.assert_allclose(found.constants, rates, atol=1e-5)
    np.testing.assert_allclose(found.initial_states, own, atol=1e-4)
    fall = np.exp(-rates[0] * t)
    a = np.tile((fall / 0.01)[None, :, None], (4, 1, 1))
    b = np.stack([-own * t * fall, np.ones((4, len(t)))], axis=-1) / 0.01
    np.testing.assert_allclose(found.covariance, schur(a, b), rtol=1e-2)


def test_initial_states_of_every_problem_at_given_constants() -> None:
    """Rosenbrock's valley, each problem with a minimum of its own."""
    low = np.array([[1.0], [-0.5], [2.0]])

    def evaluate(x: Array, c: Array, which: Index) -> Array:
        return np.column_stack([low[which, 0] - x[:, 0], c[:, 0] * (x[:, 1] - x[:, 0] ** 2)])

    start = np.array([[-1.2, 1.0], [1.0, 1.0], [0.0, 0.0]])
    objective = Objective(evaluate, np.full(2, 1e-7), free(2), np.inf)
    x, cost = fit_each(objective, start, np.array([10.0]), 200, tolerance=1e-12)
    np.testing.assert_allclose(x, np.column_stack([low, low**2]), atol=1e-4)
    assert np.all(cost < 1e-6)
    assert start[0, 0] == -1.2, "the start is left alone"


def test_a_narrow_valley_that_bends_is_followed_to_its_end() -> None:
    """Rosenbrock's valley, so narrow that straight steps are short: 40 of them end at -0.16, and 80 at 0.49."""

    def evaluate(x: Array, c: Array, which: Index) -> Array:
        return np.column_stack([1 - x[:, 0], c[:, 0] * (x[:, 1] - x[:, 0] ** 2)])

    objective = Objective(evaluate, np.full(2, 1e-7), free(2), np.inf)
    x, _ = fit_each(objective, np.array([[-1.2, 1.44]]), np.array([1e2]), 40)
    np.testing.assert_allclose(x, [[1, 1]], atol=1e-3)


def test_a_small_first_gain_is_no_end() -> None:
    """Along a direction that tells 10,000 times less than another, the first, damped steps gain nearly nothing."""

    def evaluate(x: Array, c: Array, which: Index) -> Array:
        return np.column_stack([1e4 * (x[:, 0] - x[:, 1]), x[:, 0] + x[:, 1] - 4])

    objective = Objective(evaluate, np.full(2, 1e-7), free(2), np.inf)
    x, _ = fit_each(objective, np.zeros((1, 2)), np.zeros(0), 20)
    np.testing.assert_allclose(x, [[2, 2]], atol=1e-3)


def test_a_problem_does_not_depend_on_its_neighbours() -> None:
    evaluate, _ = decays(np.array([0.8, 0.2]), np.array([[1.0], [2.0], [0.5]]), 0.01)
    c = np.array([0.7, 0.2])
    objective = Objective(evaluate, np.full(1, 1e-5), free(1), 4.0)
    together, cost = fit_each(objective, np.ones((3, 1)), c, 30)
    for k in range(3):
        alone, one = fit_each(objective, np.ones((1, 1)), c, 30, np.array([k]))
        np.testing.assert_allclose(alone[0], together[k], rtol=1e-12)
        assert one[0] == pytest.approx(cost[k], rel=1e-12)


def test_a_prior_counts_as_a_measurement() -> None:
    """One datum y with sd 1 and a prior of sd 2 about 0 meet at 4/5 y."""

    def evaluate(x: Array, c: Array, which: Index) -> Array:
        return x - np.array([[1.0], [5.0]])[which]

    objective = Objective(evaluate, np.full(1, 1e-6), Prior(np.zeros(1), np.full(1, 2.0)), np.inf)
    x, cost = fit_each(objective, np.zeros((2, 1)), np.zeros(0), 20)
    np.testing.assert_allclose(x[:, 0], [0.8, 4.0], atol=1e-3)
    np.testing.assert_allclose(cost, [0.1, 2.5], atol=1e-4)


def test_differences_agree_with_the_analytic_jacobian() -> None:
    evaluate, t = decays(np.array([0.8, 0.2]), np.array([[1.0], [2.0]]))
    x, c = np.array([[1.3], [0.4]]), np.array([0.5, -0.1])
    r, jx, jc = differences(evaluate, x, c, np.arange(2), np.full(1, 1e-6), np.full(2, 1e-6))
    fall = np.exp(-0.5 * t)
    np.testing.assert_array_equal(r, evaluate(x, np.tile(c, (2, 1)), np.arange(2)))
    np.testing.assert_allclose(jx[..., 0], np.tile(fall / 0.01, (2, 1)), rtol=1e-5)
    np.testing.assert_allclose(jc[..., 0], -x * t * fall / 0.01, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(jc[..., 1], 100.0, rtol=1e-5)


@pytest.mark.parametrize("c", [1.0, 4.0, np.inf])
def test_weights_follow_the_loss(c: float) -> None:
    r = np.array([[-30.0, -2.0, 0.0, 0.5, 8.0]])
    h = 1e-6
    slope = [(loss(r + h * e, c) - loss(r - h * e, c))[0] / (2 * h) for e in np.eye(5)]
    np.testing.assert_allclose(slope, (weights(r, c) * r)[0], atol=1e-6)
    assert loss(np.full((1, 3), np.nan), c)[0] == 0.0
    assert weights(np.full((1, 3), np.nan), c).sum() == 0.0


def test_outliers_are_ignored() -> None:
    rng = np.random.default_rng(3)
    evaluate, a, b, _ = linear(rng)
    bad = rng.random((PROBLEMS, SAMPLES)) < 0.05

    def spoiled(x: Array, c: Array, which: Index) -> Array:
        return evaluate(x, c, which) + 200.0 * bad[which]

    sd = np.sqrt(np.diag(schur(a, b)))
    start = np.zeros((PROBLEMS, 2)), np.zeros(2)
    plain, robust, clean = joint(spoiled, *start), joint(spoiled, *start, 4.0), joint(evaluate, *start, 4.0)
    assert np.abs(robust.constants - TRUE).max() < 4 * sd.max()
    assert np.abs(robust.constants - clean.constants).max() < 1.5 * sd.max()
    assert np.abs(plain.constants - TRUE).max() > 10 * sd.max()


def test_samples_that_are_missing_count_nothing() -> None:
    evaluate, *_ = linear(np.random.default_rng(4))
    gone = np.random.default_rng(5).random((PROBLEMS, SAMPLES)) < 0.3

    def holed(fill: float) -> Evaluate:
        return lambda x, c, which: np.where(gone[which], fill, evaluate(x, c, which))

    missing, absent = (joint(holed(fill), np.zeros((PROBLEMS, 2)), np.zeros(2)) for fill in (np.nan, 0.0))
    np.testing.assert_allclose(missing.constants, absent.constants, rtol=1e-9)
    np.testing.assert_allclose(missing.covariance, absent.covariance, rtol=1e-9)


def test_constants_stay_within_their_bounds() -> None:
    evaluate, *_ = linear(np.random.default_rng(6))
    bounds = np.array([[0.0, 0.5], [-3.0, 3.0]])
    found = joint(evaluate, np.zeros((PROBLEMS, 2)), np.array([0.1, 0.0]), bounds=bounds)
    assert found.constants[0] == 0.5
    assert np.all(found.constants >= bounds[:, 0]) and np.all(found.constants <= bounds[:, 1])


@pytest.mark.parametrize("seed", range(6))
def test_correlated_constants_at_bounds_leave_the_others_at_their_best(seed: int) -> None:
    """The answer of another solver (bounded-variable least squares of SciPy), and no fit that stops before it."""
    rng = np.random.default_rng(seed)
    q = 4
    mixed = rng.normal(size=(q, q)) + 2 * np.ones((q, q))
    design = rng.normal(size=(PROBLEMS, SAMPLES, q)) @ mixed
    y = design @ rng.uniform(-2, 2, q) + 0.1 * rng.normal(size=(PROBLEMS, SAMPLES))
    bounds = np.tile([-0.5, 0.5], (q, 1))
    best = lsq_linear(design.reshape(-1, q), y.ravel(), bounds.T, method="bvls", tol=1e-14)
    assert best.active_mask.any(), "else this shows nothing"

    def evaluate(x: Array, c: Array, which: Index) -> Array:
        return np.einsum("nmq,nq->nm", design[which], c) - y[which] + 0.0 * x[:, :1]

    found = joint(evaluate, np.zeros((PROBLEMS, 1)), np.zeros(q), bounds=bounds)
    assert found.converged
    knowledge = 0.5 * np.sum(found.constants**2)  # that constants stay near their start, within the bounds' width
    assert found.cost - knowledge < (1 + 1e-4) * best.cost
    np.testing.assert_allclose(found.constants, best.x, atol=0.01)


def test_what_the_data_do_not_tell_stays_and_has_no_variance() -> None:
    evaluate, a, b, _ = linear(np.random.default_rng(7))
    start = np.array([0.0, 0.0, 0.37])
    found = joint(
        lambda x, c, which: evaluate(x, c[:, :2], which),
        np.zeros((PROBLEMS, 2)), start, bounds=np.array([[-5.0, 5.0], [-5.0, 5.0], [0.0, 1.0]]),
    )  # fmt: skip
    assert found.converged
    assert found.constants[2] == pytest.approx(0.37, abs=1e-6)
    variance = np.diag(found.covariance)
    assert np.isnan(variance[2]) and np.all(np.isnan(found.covariance[2, :]))
    assert np.all(variance[:2] >= 0.99 * np.diag(schur(a, b)))


def test_nothing_known_is_no_uncertainty_at_all() -> None:
    assert np.all(np.isnan(covariance(np.zeros((3, 2, 2)), np.zeros((3, 2)), np.ones(2))))


def test_problems_that_disagree_widen_the_uncertainty() -> None:
    """Each problem pulls four times as hard as its own noise lets it: the sandwich is four times as wide."""
    rng = np.random.default_rng(8)
    information, score = np.full((400, 1, 1), 25.0), 4 * 5.0 * rng.normal(size=(400, 1))
    sd = np.sqrt(covariance(information, score, np.array([100.0]))[0, 0])
    assert sd == pytest.approx(4 / np.sqrt(400 * 25.0), rel=0.1)
    quiet = np.sqrt(covariance(information, 0 * score, np.array([100.0]))[0, 0])
    assert quiet == pytest.approx(1 / np.sqrt(400 * 25.0), rel=1e-3)


@pytest.mark.parametrize(("iterations", "converged"), [(1, False), (2, False), (40, True)])
def test_a_fit_that_runs_out_of_steps_says_so(iterations: int, converged: bool) -> None:
    rates = np.array([1.5, 0.2])
    evaluate, _ = decays(rates, np.array([[1.0], [2.0], [0.5]]))
    found = joint(evaluate, np.ones((3, 1)), np.array([0.5, 0.5]), iterations=iterations)
    assert found.converged == converged
    assert np.allclose(found.constants, rates, atol=1e-3) == converged


@pytest.mark.parametrize("start", [(-1.2, 1.0), (3.0, -3.0), (-5.0, 5.0)])
def test_a_short_step_in_a_bent_valley_is_not_convergence(start: tuple[float, float]) -> None:
    """Converged says that the constants lie within a fraction of their sd of the optimum at (1, 1)."""

    def valley(x: Array, c: Array, which: Index) -> Array:
        return np.column_stack([1 - c[:, 0], 100 * (c[:, 1] - c[:, 0] ** 2), x[:, 0]])

    found = joint(valley, np.zeros((1, 1)), np.array(start), iterations=200)
    # The first residual has sd 1, so this is 0.2 sd of the first constant.
    assert not found.converged or abs(found.constants[0] - 1) < 0.2


def test_steps_are_logged(caplog: pytest.LogCaptureFixture) -> None:
    evaluate, *_ = linear(np.random.default_rng(9))
    with caplog.at_level("INFO", logger="sysid"):
        objective = Objective(evaluate, np.full(2, 1e-5), free(2), np.inf)
        shared = SharedConstants(np.full(2, 1e-5), np.tile(WIDE, (2, 1)))
        fit_joint(objective, np.zeros((PROBLEMS, 2)), np.zeros(2), shared, what="lines")
    steps = [record.args for record in caplog.records]
    assert [k for _, k, _ in steps] == list(range(len(steps))) and len(steps) >= 1  # type: ignore[misc]
    assert all(later <= earlier for (*_, earlier), (*_, later) in itertools.pairwise(steps))  # type: ignore[misc]


@pytest.mark.parametrize("apart", [1e-6, 3e-8, 1e-8, 3e-9, 0.0])
def test_constants_that_hardly_differ_have_no_variance_below_zero(apart: float) -> None:
    """Two steps at one place, say; and what is known of another constant does not depend on its unit."""
    rng, units = np.random.default_rng(8), np.array([1.0, 1e-6, 1e4, 1e4])
    for _ in range(100):
        rows = rng.normal(size=(3, 40, 4))
        rows[..., 3] = rows[..., 2] + apart * rng.normal(size=rows.shape[:2])
        rows *= units
        rounding = 1e-11 * rng.normal(size=(3, 4, 4)) * np.outer(units, units)
        information = np.swapaxes(rows, 1, 2) @ rows + rounding + np.swapaxes(rounding, 1, 2)
        found = covariance(information, np.zeros((3, 4)), 1e9 / units)
        assert (np.diag(found) >= 0.0).all() and np.isfinite(found).all()
        own = covariance(information[:, :2, :2], np.zeros((3, 2)), 1e9 / units[:2])
        assert found[1, 1] == pytest.approx(own[1, 1], rel=0.5)


def test_singular_systems_are_regularised() -> None:
    """What is determined is solved, what is not stays, and the other systems are not touched."""
    good, right = np.array([[2.0, 1.0], [1.0, 3.0]]), np.ones((3, 2, 1))
    found = solve_each(np.array([good, [[1e-4, 0.0], [0.0, 0.0]], [[np.nan, 0.0], [0.0, 1.0]]]), right)[..., 0]
    np.testing.assert_allclose(found[0], np.linalg.solve(good, np.ones(2)), rtol=1e-6)
    assert found[1, 0] == pytest.approx(1e4, rel=1e-6)
    assert np.isfinite(found).all() and (found[2] == 0).all()
    twins = solve_each(np.ones((1, 2, 2)), np.ones((1, 2, 1)))[0, :, 0]
    np.testing.assert_allclose(twins, 0.5, rtol=1e-6)


def test_unknowns_stay_within_their_bounds() -> None:
    evaluate, _, _, own = linear(np.random.default_rng(5), noise=0.0)
    bounds = np.array([[-0.5, 0.5], [-np.inf, np.inf]])
    objective = Objective(evaluate, np.full(2, 1e-5), free(2), np.inf, bounds=bounds)
    found, _ = fit_each(objective, np.full((PROBLEMS, 2), 3.0), TRUE, 20)
    assert np.abs(found[:, 0]).max() <= 0.5 and np.abs(own[:, 0]).max() > 0.5


def test_a_constant_leaves_an_upper_bound_beyond_which_nothing_changes() -> None:
    evaluate, _, _, own = linear(np.random.default_rng(5))
    bounds = np.array([[-2.0, 1.0], [-2.0, 1.0]])

    def clipped(x: Array, c: Array, which: Index) -> Array:
        return evaluate(x, np.minimum(c, 1.0), which)

    found = joint(clipped, own, np.ones(2), bounds=bounds)
    assert found.converged
    np.testing.assert_allclose(found.constants, TRUE, atol=0.2)


def test_sums_over_a_problem_s_residuals_are_those_of_any_batch() -> None:
    """To the last bit, however many residuals its neighbours in the batch have: so any worker gives the same bytes."""
    rng = np.random.default_rng(6)
    for count in range(20, 40):
        rows, vectors, steps = rng.normal(size=(4, 3, count)), rng.normal(size=(3, count)), np.ones((3, 3))
        longer = np.full((4, 3, 37), np.nan)
        wide, wide_vectors = np.concatenate([rows, longer], axis=2), np.concatenate([vectors, longer[0]], axis=1)
        alone, beside = projected(rows, steps, vectors, 9.0), projected(wide, steps, wide_vectors, 9.0)
        assert alone.tobytes() == beside.tobytes()
        one, two = from_derivatives(rows[0], rows[1:], 9.0), from_derivatives(wide[0], wide[1:], 9.0)
        assert one.matrix.tobytes() == two.matrix.tobytes() and one.gradient.tobytes() == two.gradient.tobytes()


def test_derivatives_by_many_unknowns_are_summed_like_those_by_few() -> None:
    rng = np.random.default_rng(7)
    r, jacobian = rng.normal(size=(3, 25)), rng.normal(size=(3, 25, 6))
    r[1, 20:] = np.nan
    columns = np.moveaxis(jacobian, 2, 0)
    few = from_derivatives(r, columns, 2.0)
    for k, one in enumerate(from_columns(r, list(columns), 2.0)):
        for part in ("loss", "matrix", "gradient"):
            np.testing.assert_allclose(getattr(one, part)[0], getattr(few, part)[k], rtol=1e-12, atol=1e-12)
