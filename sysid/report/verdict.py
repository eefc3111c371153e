"""A discovery in a headline and four lines: what is missing, how much it explains, how certain it is, what to do next.

In: a `DiscoveryResult`. Out: a `Verdict`, for the terminal, the report and Python. The headline is for the table's
owner: each effect by the first words of its file, with what its constants say of the table.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from models.contract.checks import described
from models.effect import Effect
from models.report.numbers import millimetres, value_with_sd
from sysid.estimation.fitted import MISS_OVER_AXIS
from sysid.report.findings import NEW_EFFECT_COMMAND
from sysid.report.health import health
from sysid.selection.result import DiscoveryResult
from sysid.selection.screening import Screening

CERTAIN_BIC = 10.0  # "very strong" evidence (Kass and Raftery 1995), of an effect that
CERTAIN_SHARE = 0.95  # of the draws of the clips find: it is certain then
IMAGE_QUANTITIES = ("image_x", "image_y", "clock")  # of formulas: what the camera shows, not what balls do
FEW_HELD_OUT = 2  # clips held out, up to which a single one decides


@dataclass(frozen=True)
class Verdict:
    """What a discovery says."""

    headline: str
    missing: str
    size: str
    certainty: str
    next_step: str

    def lines(self) -> tuple[str, str, str, str, str]:
        """The headline, and four labelled sentences."""
        return (
            self.headline, f"missing: {self.missing}", f"size: {self.size}", f"certainty: {self.certainty}",
            f"next: {self.next_step}",
        )  # fmt: skip


def verdict_of(found: DiscoveryResult) -> Verdict:
    """The verdict on a discovery."""
    return Verdict(_headline(found), _missing(found), _size(found), _certainty(found), _next_step(found))


def _headline(found: DiscoveryResult) -> str:
    """The result in the words of a table's owner."""
    parts = [
        f"{_plain_name(found, name)} ({_how_sure(found, name)}){_of_the_table(found, name)}" for name in found.verdict
    ]
    if found.unexplained is not None:
        parts.append(f"Something that no known effect explains: {_located(found.unexplained)}")
        if left := found.unexplained.get("left"):
            parts.append(f"It leaves an error: {_located(left)}")
        if found.parts.held_out is None:
            parts.append("This is a hint: no clip is held out to test it, so film more shots")
    headline = ". ".join(parts) or "These clips show nothing that the model lacks"
    return headline if found.converged else f"{headline}. The fit did NOT converge: this is a hint"


def _located(rest: Mapping[str, Any]) -> str:
    """Where something unexplained is, and how large, where that is a length on the table."""
    if rest["unit"] == "m":
        return f"{rest['where']}, {millimetres(rest['size'])}{' rms' if 'rms' in rest['what'] else ''}"
    return (
        f"{rest['where']}, {1e3 * abs(rest['size']):.2g} mm per m" if rest["unit"] == "m per m" else str(rest["where"])
    )


def _plain_name(found: DiscoveryResult, name: str) -> str:
    """An effect in words, the first of its file."""
    says = described(type(_effect(found, name)))["says"]
    return re.split(r"[:.]\s", says, maxsplit=1)[0].rstrip(".:")


def _effect(found: DiscoveryResult, name: str) -> Effect:
    """An effect that was named."""
    return next(one for one in found.model.effects if one.name() == name)


def _how_sure(found: DiscoveryResult, name: str) -> str:
    """Certain or likely."""
    best = next((one.best for one in found.rounds if one.best is not None and one.best.name == name), None)
    seen = found.stability
    returns = seen is None or seen.times[name] >= CERTAIN_SHARE * seen.draws
    return "certain" if best is not None and best.evidence.delta_bic > CERTAIN_BIC and returns else "likely"


def _of_the_table(found: DiscoveryResult, name: str) -> str:
    """What its constants mean for the table; "" if that is not known."""
    lines = [line for line in health(found.model) if line.constant.startswith(f"{name}.") and line.determined]
    meanings = [line.brief or f"{line.what} {line.measured}, {line.verdict}" for line in lines]
    return f": {'; '.join(meanings)}" if meanings else ""


def _missing(found: DiscoveryResult) -> str:
    """The effects with their sizes, and what no effect explains."""
    parts = [_with_values(found, name) for name in found.verdict]
    rest = found.unexplained
    if rest is not None:
        depends = f", depending on {', '.join(rest['depends_on'])}" if rest["depends_on"] else ""
        form = f" ({rest['form']})" if rest["form"] else ""
        beside = "and beside it " if parts else ""
        parts.append(f"{beside}something outside the catalogue: {rest['where']}{depends}{form}")
    if not parts and (alone := _shown_by_one_clip(found)):
        name, clip = alone
        return f"nothing that more than one clip shows; {clip} alone shows {name}"
    return ", ".join(parts) or "nothing that these clips show; the model suffices"


def _shown_by_one_clip(found: DiscoveryResult) -> tuple[str, str] | None:
    """An effect that one clip alone shows, with that clip, where nothing is named."""
    return None if found.verdict else next(iter(found.shown_once.items()), None)


def _with_values(found: DiscoveryResult, name: str) -> str:
    """An effect with its constants."""
    model, effect = found.model, _effect(found, name)
    values = []
    for key, meta in effect.parameters().items():
        known = model.estimates.get(f"{name}.{key}")
        sd = known.sd if known else math.nan
        unit = "" if meta["unit"] == "1" else f" {meta['unit']}"
        values.append(f"{key} {value_with_sd(float(getattr(effect, key)), sd)}{unit}")
    return f"{name} ({', '.join(values)})"


def _size(found: DiscoveryResult) -> str:
    """The rms miss before and after, and what the noise leaves."""
    first, last = found.ladder[0], found.explained or found.last
    floor = f"noise alone leaves {millimetres(MISS_OVER_AXIS * found.parts.noise)}"
    held = math.isfinite(last.held_miss)
    if last is first:
        beside = f" (held out {millimetres(first.held_miss)})" if held else ""
        return f"the rms miss is {millimetres(first.miss)}{beside}; {floor}"
    beside = f" (held out {millimetres(first.held_miss)} to {millimetres(last.held_miss)})" if held else ""
    goes = "falls" if last.miss < first.miss else "rises"
    return f"the rms miss {goes} from {millimetres(first.miss)} to {millimetres(last.miss)}{beside}; {floor}"


def _certainty(found: DiscoveryResult) -> str:
    """Delta BIC of what was named, how often it returns, and what speaks against it."""
    doubts = [] if found.converged else ["the last fit did NOT converge, so this is a hint"]
    named = [(seen.best, seen) for seen in found.rounds if seen.best is not None and seen.best.name in found.verdict]
    words = [
        f"{best.name} has a delta BIC of {best.evidence.delta_bic:.0f}{_over_next(seen)}{_returns(found, best.name)}"
        for best, seen in named
    ]
    if found.unexplained is not None and found.unexplained.get("delta_bic") is not None:
        words.append(f"what is outside the catalogue has a delta BIC of {found.unexplained['delta_bic']:.0f}")
    if not words:
        words = ["nothing is likelier than that the model lacks nothing"]
    held = found.parts.held_out
    if held is None or len(held.clips) <= FEW_HELD_OUT:
        doubts.append("few clips are held out to judge it by" if held else "no clip is held out to judge it by")
    return "; ".join([*words, *doubts])


def _returns(found: DiscoveryResult, name: str) -> str:
    """How often an effect returns on other draws of the clips."""
    seen = found.stability
    return "" if seen is None else f", and is found in {seen.times[name]} of {seen.draws} draws of the clips"


def _over_next(seen: Screening) -> str:
    """By how much the best candidate of a round leads."""
    return f", {seen.margin:.0f} more than the next" if math.isfinite(seen.margin) else ""


def _next_step(found: DiscoveryResult) -> str:
    """What to do now."""
    if found.unexplained is not None and found.unexplained["terms"]:
        add = f"add what is outside the catalogue as an effect: {NEW_EFFECT_COMMAND}"
        if all(term["door"] in IMAGE_QUANTITIES for term in found.unexplained["terms"]):
            return f"calibrate the camera again, as what is left is in its picture and not on the table; or {add}"
        return add
    if alone := _shown_by_one_clip(found):
        name, clip = alone
        return f"film more shots like {clip}, to see whether {name} is there"
    shot, remedies = found.next_shot, _remedies(found)
    at_table = f"{' and '.join(remedies)}, then film again" if remedies else ""
    if shot is not None:
        before = f"{at_table}; before that, " if at_table else ""
        return f"{before}film this shot ({shot.why}): {shot.in_words()}"
    return at_table or "plan shots with this model; film more clips to find what these do not show"


def _remedies(found: DiscoveryResult) -> list[str]:
    """What to do at the table against the effects that are certain."""
    certain = [f"{name}." for name in found.verdict if _how_sure(found, name) == "certain"]
    return [line.remedy for line in health(found.model) if line.remedy and line.constant.startswith(tuple(certain))]
