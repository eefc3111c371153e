"""Balls that touch each other, as in a rack: a blob that one disc does not explain is explained by several.

In: a picture beside the background, and where discs may be. Out: `DiscFit`s. Every disc is fitted to the cover that the
others leave, in turn, until none moves any more; the others cover as much as balls of their known size do. Then each is
judged as a single one is; the worst that is no ball goes, and those beside it settle anew.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sysid.vision.balls.background import View
from sysid.vision.balls.candidates import candidates
from sysid.vision.balls.cover import RING_RADII, SAME_PLACE_PX, DiscFit, acceptable, covered, fit_disc
from sysid.vision.balls.intruders import intruding, shows
from sysid.vision.balls.view_geometry import Array, Mask

REACH_RADII = 1.0 + RING_RADII[1]  # between two centres, within which one covers a part of the other's surroundings
MIN_DISTANCE_RADII = 1.6  # on the table: balls that touch have 2, less a cell of `CoarseGrid` at either end
MAX_FITS_EACH = 12  # of a disc among others, against two that push each other to and fro


def disc_at(view: View, pixel: Array, motion: Array | None = None) -> DiscFit:
    """The disc of a ball at a pixel (2,) that moves by `motion` (2,) [pixels], before it is fitted."""
    still = np.zeros(2) if motion is None else motion
    return DiscFit(np.asarray(pixel), view.geometry.radius(pixel), still, 1.0, 0.0, 0.0, 0.0, 1.0, 0.0)


@dataclass(frozen=True)
class Searched:
    """What a picture shows in which balls are sought: what comes in over cushions, and where balls may touch others."""

    intruders: Mask  # (h, w)
    starts: Sequence[Array]  # pixels (2,): centres of outlines, but for those of an arm's pieces


def searched(view: View) -> Searched:
    """What a picture shows in which balls are sought."""
    starts, intruders = candidates(view), intruding(view)
    hidden = shows(intruders, np.reshape(starts, (-1, 2)))
    return Searched(intruders, [at for at, inside in zip(starts, hidden, strict=True) if not inside])


def with_packs(
    view: View, shown_at: Callable[[Array], Array | None], found: Sequence[DiscFit], starts: Sequence[Array], kind: str,
    taken: Sequence[DiscFit],
) -> list[DiscFit]:  # fmt: skip
    """The balls found alone, and those that touch others, which begin at pixels (2,), best first.

    `shown_at` is their colour (3,) in the light at a pixel (2,). Discs that are taken are not sought.
    """
    discs = list(found)
    for at in starts:
        if _is_covered(view, shown_at(at), at) and not _overlaps(view, at, [*discs, *taken]):
            discs.append(disc_at(view, at))
    alone, pack = apart(discs, taken)
    colours = [shown_at(discs[k].xy) for k in pack]
    fits = together(view, colours, [discs[k] for k in pack], kind, taken)
    return [*(discs[k] for k in alone if k < len(found)), *(fit for fit in fits if fit is not None)]


def apart(discs: Sequence[DiscFit], fixed: Sequence[DiscFit] = ()) -> tuple[list[int], list[int]]:
    """Which of these discs are alone, and which are beside others or those that are `fixed`."""
    beside = [any(_reaches(one, other) for other in (*discs, *fixed) if other is not one) for one in discs]
    return [k for k, near in enumerate(beside) if not near], [k for k, near in enumerate(beside) if near]


def together(
    view: View, colours: Sequence[Array | None], discs: Sequence[DiscFit], kind: str, fixed: Sequence[DiscFit] = ()
) -> list[DiscFit | None]:
    """Discs of these colours, each fitted beside the others and those that are `fixed`; None where none is a ball."""
    now: dict[int, DiscFit] = dict(enumerate(discs))
    fits_left = dict.fromkeys(now, MAX_FITS_EACH)
    waiting = list(now)
    while True:
        while waiting:
            k = waiting.pop(0)
            if k not in now or not fits_left[k]:
                continue
            fits_left[k] -= 1
            before, beside = now[k], [j for j in now if j != k and _reaches(now[j], now[k])]
            others = [*(now[j] for j in beside), *(one for one in fixed if _reaches(one, before))]
            radius = view.geometry.radius(before.xy)
            # Of known size: one that grows over its shadow takes nothing from its neighbours.
            sized = [replace(one, radius=view.geometry.radius(one.xy)) for one in others]
            fit = fit_disc(view, colours[k], before.xy, radius, before.motion, before.gain, others=sized)
            if fit is None or not acceptable(fit, "known"):  # it will be none when all have settled
                del now[k]
                waiting += [j for j in beside if j not in waiting]
                continue
            now[k] = fit
            if math.hypot(*(fit.xy - before.xy)) > SAME_PLACE_PX:
                waiting += [j for j in beside if j not in waiting]
        bad = [k for k, fit in now.items() if not _is_ball(view, fit, kind, [now[j] for j in now if j != k])]
        if not bad:
            break
        worst = now.pop(min(bad, key=lambda k: now[k].rim - now[k].residual))
        waiting = [k for k, fit in now.items() if _reaches(worst, fit)]
    return [now.get(k) for k in range(len(discs))]


def _is_ball(view: View, fit: DiscFit, kind: str, others: Sequence[DiscFit]) -> bool:
    """Whether a fit shows a ball on the bed, and not within others."""
    return acceptable(fit, kind) and view.geometry.on_bed(fit.xy) and not _overlaps(view, fit.xy, others)


def _reaches(one: DiscFit, other: DiscFit) -> bool:
    """Whether a disc covers a part of the surroundings of another."""
    sweep = (math.hypot(*one.motion) + math.hypot(*other.motion)) / 2
    return math.hypot(*(one.xy - other.xy)) < REACH_RADII * max(one.radius, other.radius) + sweep


def _overlaps(view: View, pixel: Array, others: Sequence[DiscFit]) -> bool:
    """Whether a ball at a pixel (2,) would be within one of the others."""
    camera = view.geometry.camera
    places = camera.on_plane(np.array([pixel, *(one.xy for one in others)]), camera.radius)
    return bool((np.linalg.norm(places[1:] - places[0], axis=1) < MIN_DISTANCE_RADII * camera.radius).any())


def _is_covered(view: View, colour: Array | None, pixel: Array) -> bool:
    """Whether most of a ball at a pixel (2,) would show this colour."""
    window, table, _ = view.window(pixel, view.geometry.radius(pixel) / 2)
    return bool(window.size and np.median(covered(window, table, colour)) > 0.5)
