"""The whole loop: fit, look for what is missing, add it, until nothing more is to be explained."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from models.model_file import Model
from sysid.clips import ClipSet
from sysid.estimation.fitted import FittedModel
from sysid.estimation.problem import Array
from sysid.estimation.split import Split, begin, fit_on
from sysid.selection.evidence import LACKING_LOSS, compare_fits, loss_without, taken_out
from sysid.selection.formula import NAME, Structure, describe
from sysid.selection.judge import judge
from sysid.selection.next_shot import NextShot, propose
from sysid.selection.remainder import remainder
from sysid.selection.score import Candidate
from sysid.selection.screening import MATTERS, NAMED, Round, warm_started

MOST = 6  # effects added
HIDDEN = 0.05  # of the bounds' width: an effect whose sd exceeds it cannot be told from the active ones
POWER = 3.0  # standard deviations of an effect that the next shot is to bring out
log = logging.getLogger(__name__)
Save = Callable[["Discovery"], None]


@dataclass(frozen=True)
class Discovery:
    """What was found."""

    parts: Split
    ladder: tuple[FittedModel, ...]  # base first
    verdicts: tuple[tuple[str, ...], ...]  # named effects in each of them
    rounds: tuple[Round, ...]
    unexplained: Mapping[str, Any] | None = None  # what no effect of the catalogue explains
    explained: FittedModel | None = None  # the last one with the formula for it
    next_shot: NextShot | None = None
    pruned: tuple[str, ...] = ()

    @property
    def verdict(self) -> tuple[str, ...]:
        """Effects added, in order."""
        return self.verdicts[-1]

    @property
    def last(self) -> FittedModel:
        """The model that was found."""
        return self.ladder[-1]

    @property
    def alike(self) -> tuple[tuple[str, str], ...]:
        """Look-alikes of what was found."""
        found = {(a, b) for r in self.rounds for a, b, _ in r.alike} | {p for r in self.rounds for p in r.tied}
        return tuple(sorted(found))


def without(parts: Split, found: FittedModel, name: str) -> FittedModel:
    """The fit without an effect, fitted again."""
    plain = fit_on(parts, taken_out(found, name), found, f"without {name}")
    return warm_started(parts, plain, found, f"without {name}") or plain


def needed(parts: Split, found: Discovery) -> Discovery:
    """Without effects that were named beside a fit in a false optimum, and that the one found since does without."""
    now, verdict = found.last, found.verdict
    while len(verdict) > 1:
        log.info("whether all of them are needed")
        times = [loss_without(now, name) for name in verdict]
        k = int(np.argmin(times))
        if times[k] > LACKING_LOSS:
            break
        less = without(parts, now, verdict[k])
        if compare_fits(less, now).delta_bic > NAMED:
            break
        log.info("%s is not needed", verdict[k])
        now, verdict = less, (*verdict[:k], *verdict[k + 1 :])
    return found if verdict == found.verdict else _ending(found, now, verdict)


def _ending(found: Discovery, now: FittedModel, verdict: tuple[str, ...]) -> Discovery:
    """The ladder with another end: the fits on the way to it are those that name a part of it."""
    way = [(s, v) for s, v in zip(found.ladder, found.verdicts, strict=True) if set(v) < set(verdict) or not v]
    way = way[: len(verdict)]
    return dataclasses.replace(
        found, ladder=(*(s for s, _ in way), now), verdicts=(*(v for _, v in way), verdict),
        pruned=tuple(v for v in found.verdict if v not in verdict),
    )  # fmt: skip


def discover(
    clip_set: ClipSet, model: Model, save: Save = lambda found: None, resumed: Discovery | None = None
) -> Discovery:
    """Add effects until no candidate is worth it; then drop those that are no longer needed.

    Args:
        clip_set: every fifth clip is held out.
        model: what to start from; all its constants are fitted.
        save: given what was found so far, after each effect.
        resumed: what an earlier, interrupted run saved.
    """
    if resumed is None:
        parts, now = begin(clip_set, model)
        found = Discovery(parts, (now,), ((),), ())
        save(found)
    else:
        found, parts, now = resumed, resumed.parts, resumed.last
    structure: Structure | None = None
    smooth = True  # whether runs without impacts may tell something
    for _ in range(MOST):
        judged = judge(parts, now, formula=structure is None, smooth=smooth)
        found = dataclasses.replace(found, rounds=(*found.rounds, *judged.rounds))
        smooth = judged.believed is not None
        if judged.believed is not None and judged.name is not None:
            log.info("found %s", judged.name)
            now, verdict = judged.believed, (*found.verdict, judged.name)
            found = dataclasses.replace(found, ladder=(*found.ladder, now), verdicts=(*found.verdicts, verdict))
            save(found)
            continue
        if judged.round.base is not now:
            now = judged.round.base
            if structure is None:
                found = dataclasses.replace(found, ladder=(*found.ladder[:-1], now))
        if judged.structure is not None and judged.trial is not None:
            structure, now = judged.structure, judged.trial.fitted
            found = dataclasses.replace(found, unexplained=describe(structure, now, judged.trial.evidence))
            continue
        best = judged.round.best
        if best is None:
            break
        log.info("found %s", best.name)
        now, verdict = best.fitted, (*found.verdict, best.name)
        found = dataclasses.replace(found, ladder=(*found.ladder, now), verdicts=(*found.verdicts, verdict))
        if structure is None:
            save(found)
    if structure is not None:
        found = _with_formula(parts, found, now, structure)
    else:
        found = needed(parts, found)
    if found.unexplained is None:
        found = dataclasses.replace(found, unexplained=remainder(found.last))
    return dataclasses.replace(found, next_shot=best_next(parts, found.last, found.rounds, found.verdict))


def _with_formula(parts: Split, found: Discovery, now: FittedModel, structure: Structure) -> Discovery:
    """The verdict beside the formula; the model file holds named effects only.

    Effects that were named beside the formula may explain what it was found for.
    """
    plain = without(parts, now, NAME)
    worth = compare_fits(plain, now)
    found = _ending(found, plain, found.verdict)
    if worth.delta_bic <= NAMED or worth.gain <= MATTERS * found.rounds[-1].count:
        log.info("the formula is no longer needed")
        return dataclasses.replace(found, unexplained=None)
    told = describe(structure, now, worth)
    told |= {"rms_m": now.rms, "held_out_rms_m": now.held_rms, "chi2_reduced": now.chi2}
    return dataclasses.replace(found, unexplained=told, explained=now)


def _width(one: Candidate) -> Array:
    known = one.effect.parameters()
    return np.array([np.subtract(*known[k]["bounds"][::-1]) for k in one.keys])


def best_next(parts: Split, now: FittedModel, rounds: Sequence[Round], verdict: Sequence[str]) -> NextShot | None:
    """The shot that parts the verdict from its nearest rival, or brings out what these clips say least about."""
    if not rounds:
        return None
    log.info("the next shot")
    named = [r for r in rounds if r.best is not None and r.best.name in verdict]
    if named:
        best = named[-1].best
        rivals = [t for t in named[-1].trials if best and t.name != best.name]
        if best and rivals:
            rival = rivals[0].fitted
            why = f"parts {best.name} from {rivals[0].name}, the next best"
            return propose(rival, best.fitted.model, rival.covariance, parts.noise, why)
    scores = rounds[-1].scores
    shy = [row for row in scores.rows if np.all(row.sd > 0) and np.all(row.sd < HIDDEN * _width(row.candidate))]
    if not shy:
        return None

    # An effect that the active ones can imitate wholly is hidden at any size: no shot brings it out.
    def power(k: int) -> float:  # how large an effect these clips could hide, of its usual size
        one = shy[k].candidate
        usual = np.array([getattr(one.effect, key) for key in one.keys]) - one.off()
        return float(np.max(shy[k].sd / np.maximum(np.abs(usual), 1e-12)))

    row = shy[int(np.argmax([power(k) for k in range(len(shy))]))]
    one = row.candidate
    bounds = np.array([one.effect.parameters()[k]["bounds"] for k in one.keys])
    value = np.clip(one.off() + POWER * row.sd, bounds[:, 0], bounds[:, 1])
    hidden = ", ".join(f"{k} = {v:.3g}" for k, v in zip(one.keys, value, strict=True))
    why = f"these clips say least about {one.name}: they could hide {hidden}"
    other = now.model.add(one.at(value))
    return propose(now, other, now.covariance, parts.noise, why)
