"""What a discovery finds: the ladder of fits, the screenings on the way, what stays unexplained, the next shot."""

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
    """What was found, so far or in the end."""

    parts: Split
    ladder: tuple[FittedModel, ...]  # base first
    verdicts: tuple[tuple[str, ...], ...]  # named effects in each of them
    rounds: tuple[Screening, ...]
    unexplained: Mapping[str, Any] | None = None  # what no effect of the catalogue explains, as result.json has it
    explained: FittedModel | None = None  # the last fit with the formula for it
    next_shots: tuple[NextShot, ...] = ()  # to film, the best first
    stability: Stability | None = None  # how often the verdict returns; None beside a formula
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
        """The fit that was found."""
        return self.ladder[-1]

    @property
    def converged(self) -> bool:
        """Whether the fit did whose constants the model has, see `model_of`."""
        return (self.explained or self.last).converged

    @property
    def model(self) -> Model:
        """The model that was found, with values, standard deviations, correlations and sources."""
        return self.model_of(self.last)

    def model_of(self, fitted: FittedModel, command: str = "sysid discover") -> Model:
        """The model of one step of the ladder.

        With a formula for what no effect explains, the constants of the last step are those of the fit that included
        it: without the formula they bend to make up for what is missing.
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
        """Effects with evidence in the training clips whose fits followed the held-out ones worse."""
        return frozenset(name for one in self.rounds for name in one.refuted)

    def with_step(self, now: FittedModel, verdict: tuple[str, ...], dropped: tuple[str, ...]) -> DiscoveryResult:
        """The ladder with another last fit, after those that have only effects of its verdict.

        Args:
            now: the fit.
            verdict: its effects.
            dropped: those that were named and are no longer.
        """
        steps = [(s, v) for s, v in zip(self.ladder, self.verdicts, strict=True) if set(v) < set(verdict)]
        steps.append((now, verdict))
        return dataclasses.replace(
            self, ladder=tuple(s for s, _ in steps), verdicts=tuple(v for _, v in steps), pruned=dropped
        )
