"""Where a fit lacks something, and of what it depends there: all causes, named or not, by one marginal likelihood.

In: the quadratic losses of a fit's shots beside all candidates (`Scores`). Out: `Cause`s, the likeliest first.

A named effect adds its parameters, a free form (models/free_form.py) an unknown smooth function: both are Gaussian
unknowns beside the constants. A function is a Gaussian process of unknown size and smoothness; a named effect has an
unknown size about its usual one. With projected information S and gradient g of the unknowns and their covariance C,
the marginal likelihood with them over that without is

    log B = g' (S + C^-1)^-1 g / 2 - log det(1 + C S) / 2

(C. E. Rasmussen and C. K. I. Williams, Gaussian Processes for Machine Learning, 2006, chapter 5), averaged over sizes
and smoothnesses. What many coefficients could explain by chance is so paid for, without a threshold for each.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from sysid.estimation.problem import Array
from sysid.selection.formulas.free_forms import Block
from sysid.selection.scoring.score import Scores

SIZES = np.geomspace(3e-3, 1.0, 12)  # standard deviations of a function, over its quantity's width
USUAL_SIZES = np.geomspace(0.05, 3.0, 12)  # the same of a named effect, over its usual value
LEAST_VARIANCE = 1e-9  # added to a covariance, of its mean variance


@dataclass(frozen=True)
class Cause:
    """What may be missing."""

    name: str
    log_odds: float  # marginal likelihood with it over that with nothing
    block: Block | None  # None for a named effect
    mean: Array  # (k,) its parameters, as distances from where it does nothing, where they are likeliest
    gain: float  # fall of chi-square by these, predicted
    constants: Mapping[str, float]  # of the fit, by name, that go with these

    @property
    def is_of_order(self) -> bool:
        """Whether it is a function of the clips' order, by which each may have a value of its own."""
        return self.block is not None and "order" in self.block.variables and not self.block.is_drift


def log_odds(information: Array, gradient: Array, covariance: Array) -> Array:
    """Marginal likelihood with Gaussian unknowns over that without, of quadratic losses; see the module.

    Args:
        information: (..., k, k) of the losses.
        gradient: (..., k) where the unknowns do nothing.
        covariance: (..., k, k) of the unknowns.
    """
    root = np.linalg.cholesky(_regular(covariance))
    across = np.swapaxes(root, -1, -2)
    matrix, right = np.eye(root.shape[-1]) + across @ information @ root, across @ gradient[..., None]
    fall = np.sum(right * np.linalg.solve(matrix, right), axis=(-1, -2))
    return np.asarray(0.5 * fall - 0.5 * np.linalg.slogdet(matrix)[1])


def _regular(covariance: Array) -> Array:
    """That has an inverse: (..., k, k)."""
    k = covariance.shape[-1]
    mean = np.trace(covariance, axis1=-2, axis2=-1)[..., None, None] / k
    return np.asarray(covariance + LEAST_VARIANCE * mean * np.eye(k))


def causes(scores: Scores, free: Sequence[Block] = ()) -> list[Cause]:
    """All candidates that were scored, the likeliest first; those of blocks are `free`."""
    by_name = {block.name: block for block in free}
    usual = usual_values(scores)
    found = [cause_of(scores, usual, (name,), by_name.get(name)) for name in scores.blocks]
    return sorted(found, key=lambda cause: -cause.log_odds)


def usual_values(scores: Scores) -> dict[str, Array]:
    """Of the parameters of every candidate that was scored."""
    return {row.candidate.name: row.candidate.usual() for row in scores.rows}


def cause_of(scores: Scores, usual: dict[str, Array], names: Sequence[str], block: Block | None = None) -> Cause:
    """A candidate, which may be a block, or several together, as a cause of the first one's name."""
    at = np.concatenate([np.arange(scores.blocks[name].start, scores.blocks[name].stop) for name in names])
    probe = scores.probe[at]
    information = scores.schur_information[np.ix_(at, at)] / np.outer(probe, probe)
    gradient = scores.gradient[at] / probe
    if block is None:
        size_of = np.concatenate([usual[name] for name in names])
        priors = [np.diag((size * size_of) ** 2) for size in USUAL_SIZES]
    else:
        priors = [(size * block.width) ** 2 * shape for shape in block.correlations() for size in SIZES]
    odds = log_odds(information, gradient, np.stack(priors))
    prior = priors[int(np.argmax(odds))]
    mean = -np.asarray(np.linalg.solve(information + np.linalg.inv(_regular(prior)), gradient), float)
    gain = -float(2.0 * gradient @ mean + mean @ information @ mean)
    return Cause(names[0], float(mean_odds(odds)), block, mean, gain, scores.constants_beside(at, mean))


def mean_odds(odds: Array) -> Array:
    """Log odds (...,) of what is one of n things, each as likely beforehand, from those of the things: (n, ...)."""
    return np.asarray(np.logaddexp.reduce(odds, axis=0) - math.log(len(odds)))
