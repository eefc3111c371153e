"""The result of a discovery: the ladder of fits, the screenings, unexplained structure, the next shots."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from models.model_file import Model
from sysid.estimation.fitted import FittedModel, as_model
from sysid.estimation.split import Split
from sysid.selection.next_shot import NextShot
from sysid.selection.screening import Screening
from sysid.selection.stability import Stability

Show = Callable[["DiscoveryResult"], None]


@dataclass(frozen=True)
class DiscoveryResult:
    """The result of a discovery, intermediate or final."""

    parts: Split
    ladder: tuple[FittedModel, ...]  # the base first
    verdicts: tuple[tuple[str, ...], ...]  # named effects of each
    rounds: tuple[Screening, ...]
    unexplained: Mapping[str, Any] | None = None  # structure outside the catalogue, as in result.json
    explained: FittedModel | None = None  # the last fit with a formula for that structure
    next_shots: tuple[NextShot, ...] = ()  # to film, the best first
    stability: Stability | None = None  # reproducibility of the verdict; None if there is a formula
    pruned: tuple[str, ...] = ()  # effects that were named and later dropped

    @property
    def verdict(self) -> tuple[str, ...]:
        """Effects added, in order."""
        return self.verdicts[-1]

    @property
    def next_shot(self) -> NextShot | None:
        """The first of the next shots."""
        return self.next_shots[0] if self.next_shots else None

    @property
    def last(self) -> FittedModel:
        """The last fit."""
        return self.ladder[-1]

    @property
    def converged(self) -> bool:
        """Whether the fit converged from which the model takes its constants, see `model_of`."""
        return (self.explained or self.last).converged

    @property
    def model(self) -> Model:
        """The discovered model, with values, standard deviations, correlations and sources."""
        return self.model_of(self.last)

    def model_of(self, fitted: FittedModel, command: str = "sysid discover") -> Model:
        """The model of one step of the ladder.

        If there is a formula for unexplained structure, the constants of the last step are those of the fit with it;
        without the formula they would be biased by what is missing.
        """
        if fitted is self.last and self.explained is not None:
            problem = self.explained.problem.with_model(fitted.model, self.explained.names)
            fitted = dataclasses.replace(self.explained, problem=problem)
        return as_model(fitted, command, [c.file for c in self.parts.training.clips])

    @property
    def confounded(self) -> tuple[tuple[str, str], ...]:
        """Pairs of effects that the clips confound, or that the evidence did not separate."""
        found = {(a, b) for r in self.rounds for a, b, _ in r.confounded} | {p for r in self.rounds for p in r.tied}
        return tuple(sorted(found))

    @property
    def refuted(self) -> frozenset[str]:
        """Effects supported by the training clips whose fits followed the held-out clips worse."""
        return frozenset(name for one in self.rounds for name in one.refuted)

    @property
    def shown_once(self) -> dict[str, str]:
        """Effects that are not named because one clip alone shows them, with that clip."""
        found = {name: clip for one in self.rounds for name, clip in one.shown_once.items()}
        return {name: clip for name, clip in found.items() if name not in self.verdict}

    def with_step(self, now: FittedModel, verdict: tuple[str, ...], dropped: tuple[str, ...]) -> DiscoveryResult:
        """The result with another last fit, after the ladder's steps with only effects of its verdict.

        Args:
            now: the fit.
            verdict: its effects.
            dropped: effects that were named before.
        """
        steps = [(s, v) for s, v in zip(self.ladder, self.verdicts, strict=True) if set(v) < set(verdict)]
        steps.append((now, verdict))
        return dataclasses.replace(
            self, ladder=tuple(s for s, _ in steps), verdicts=tuple(v for _, v in steps), pruned=dropped
        )
