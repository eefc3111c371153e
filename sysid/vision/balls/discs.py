"""Balls in pictures whose edges are rough, as compression, bloom and motion make them: by what they cover.

In: a picture beside the background, the colours of the balls, and where they are expected. Out: `DiscFit`s
(cover.py). A ball is first sought where its disc covers more than the ring around it does, then its disc is fitted,
swept along its motion during the exposure. What is no disc of that colour, as a hand, a cue or projected light, has
too little rim.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from sysid.vision.balls.background import View
from sysid.vision.balls.candidates import motion_blurred, peaks
from sysid.vision.balls.colours.palette import colour_distance
from sysid.vision.balls.cover import (
    DiscFit,
    acceptable,
    cover_sd,
    fit_disc,
    is_white,
    swept_share,
    without_table,
)
from sysid.vision.balls.intruders import is_part
from sysid.vision.balls.packs import Searched, apart, disc_at, searched, together, with_packs
from sysid.vision.balls.sweeps import strips
from sysid.vision.balls.view_geometry import Array

CLEAR_RESIDUAL = 0.2  # of a motion that needs no other to be tried
SWEEP_RATIO = 1.15  # of misfits, by which a ball that stands still must explain a picture better than a moving one
LEAST_SWEEP_RADII = 0.1  # of a motion, below which a disc is not swept
MAX_MOTION_ERROR_PX = 1.0  # of a sweep, beyond which a disc is fitted again with the motion of its first fit
MAX_REFITS = 3  # of a disc, each with the motion of the fit before
TRIED_GAINS = (1.0, 1.5, 2.5, 4.0)  # by which it is, tried until they are known
RANKING_STEPS = 8  # of least squares, after which it is seen which of several fits is best,
RANKING_MARGIN = 0.1  # and which have a misfit so far beyond the least that they will not become rivals
TRIED_EXPOSURES = (0.25, 0.5, 0.75, 1.0)  # of the time between two frames, tried until it is known
MIN_SWEEP_RADII = 0.4  # of a motion from which the exposure can be estimated
MAX_UNEVENNESS = 0.25  # of such a step, relative to the one before
MIN_SHUTTER_FITS = 4  # from which it is known
MIN_EVEN_FITS = 16  # of white balls, fewer than those of them overexposed, that show that none is
MISFIT_MARGIN = 0.02  # beyond that of the best fit, from which on another is no rival
SEARCH_RADII = 6.0  # of the window in which a ball is sought that is not where it was expected
TRIED_LENGTHS = (0.8, 1.0, 1.2)  # of the motion that a strip shows
NEAR_RADII = 0.6  # to the expected place, within which a ball is taken at once
CORE_RADII = 0.55  # of a disc that shows the colour of the ball
# Of a ball's colours about their mean, as it turns, in other light or under a hand (Cauchy). In ten films the median of
# moving balls was 0.006 to 0.07, mostly 0.02 to 0.05; any scale from 0.02 to 0.1 gives nearly the same tracks, but not
# of a break.
FACE_COLOUR_SCALE = 0.03
MIN_BED_CONTRAST = 0.12  # of colours, between a ball and the bed


def face_cost(seen: Array, known: Array) -> float:
    """Negative log likelihood of a colour (3,) as that of a ball of a known one, which turns as it rolls."""
    off = float(colour_distance(seen, known)) / FACE_COLOUR_SCALE
    return 2 * math.log1p(off * off)  # of a Cauchy distribution over three channels, relative to its peak


@dataclass(frozen=True)
class Expected:
    """A ball that is followed, and where it is expected."""

    name: str
    xy: Array  # (2,) centre of its outline [pixels]
    step: Array = field(default_factory=lambda: np.zeros(2))  # (2,) from frame to frame [pixels]
    colour: Array | None = None  # (3,) of its face, as it was seen last, in white light, 0 to 1
    max_move: float = 0.0  # that a ball just struck or hit moves at most from frame to frame [pixels]
    even: bool = True  # whether it is expected without an impact since the frame before


@dataclass
class Shutter:
    """How long the shutter is open, and how overexposed white balls are, estimated from the sweep of moving balls."""

    given: float | None = None  # fraction of the time between frames
    fractions: list[float] = field(default_factory=list)  # of fits of moving balls
    gains: list[float] = field(default_factory=list)  # of those of white ones

    @property
    def fraction(self) -> float | None:
        """The fraction of the time between frames; None while it is not known."""
        if self.given is not None:
            return self.given
        return float(np.median(self.fractions)) if len(self.fractions) >= MIN_SHUTTER_FITS else None

    @property
    def gain(self) -> float | None:
        """By which white balls are overexposed, 1 for not at all; None while it is not known."""
        over = [gain for gain in self.gains if gain > 1.0]
        if len(over) >= MIN_SHUTTER_FITS:
            return float(np.median(over))
        return 1.0 if len(self.gains) >= MIN_EVEN_FITS else None

    def tried(self, colour: Array | None) -> Sequence[tuple[float, float]]:
        """Fractions and gains to try with a ball of a colour (3,) blue, green, red [grey levels]."""
        fraction, gain = self.fraction, self.gain if is_white(colour) else 1.0
        fractions = TRIED_EXPOSURES if fraction is None else (fraction,)
        gains = TRIED_GAINS if gain is None else (gain,)
        return [(part, more) for part in fractions for more in gains]


def new_discs(
    view: View, colour: Array | None, shown_at: Callable[[Array], Array] | None = None, kind: str = "new",
    taken: Sequence[DiscFit] = (), picture: Searched | None = None,
) -> list[DiscFit]:  # fmt: skip
    """Balls of this colour anywhere on the bed, not moving fast, but for those taken.

    `shown_at` is the colour in the light at a pixel (2,). Pieces of what comes in over a cushion, as an arm, are none.
    """

    def shown(at: Array) -> Array | None:
        return colour if shown_at is None else shown_at(at)

    fits, picture = [], picture or searched(view)
    for at in peaks(view, colour):
        if any(np.hypot(*(at - other.xy)) < other.radius for other in taken) or is_part(picture.intruders, view, at):
            continue
        fits.append(fit_disc(view, shown(at), at, view.geometry.radius(at), np.zeros(2)))
    found: list[DiscFit] = []
    for fit in sorted((f for f in fits if f is not None and acceptable(f, kind)), key=lambda f: f.residual):
        apart = all(np.hypot(*(fit.xy - other.xy)) > fit.radius for other in found)
        if apart and view.geometry.on_bed(fit.xy):
            found.append(fit)
    return with_packs(view, shown, found, picture.starts, kind, taken)


def is_disc(view: View, pixel: Array, *, patterned: bool = False) -> bool:
    """Whether what is seen about a pixel (2,) covers the table as a disc does, at rest or in motion.

    A cue, a sleeve or a fold of light may have an outline, and has no such rim. What has the table's own colour covers
    nothing that could be judged, and passes. Balls of several colours are judged by whatever is not the table.
    """
    radius = view.geometry.radius(pixel)
    seen = core_colour(view, DiscFit(pixel, radius, np.zeros(2), 1.0, 0.0, 0.0, 0.0, 1.0, 1.0))
    row, column = (round(float(v)) for v in pixel[::-1])
    height, width = view.table.shape[:2]
    table = view.table[min(max(row, 0), height - 1), min(max(column, 0), width - 1)] * view.gain
    if not colour_distance(seen / 255, table / 255) > MIN_BED_CONTRAST:
        return True
    blur = motion_blurred(view, pixel)
    motions = [np.zeros(2), *([] if blur is None else [blur[1]])]
    colour = None if patterned else seen
    return any(acceptable(fit_disc(view, colour, pixel, radius, motion), "new") for motion in motions)


def near_disc(view: View, colour: Array | None, at: Array, step: Array, shutter: Shutter) -> DiscFit | None:
    """A ball of this colour where it is expected, a pixel (2,), after a `step` (2,) [pixels]; None where it is not."""
    radius = view.geometry.radius(at)
    fit = _best(view, colour, at, step, radius, shutter)
    near = fit is not None and math.hypot(*(fit.xy - at)) < NEAR_RADII * radius
    return fit if near and acceptable(fit, "known") else None


def beside_others(
    view: View, colours: Sequence[Array | None], expected: Sequence[Expected], fits: Sequence[DiscFit | None]
) -> list[DiscFit | None]:
    """The fits of balls that are expected, those that touch others fitted beside these where they are seen so."""
    motions = [None if fit is None else fit.motion for fit in fits]
    discs = [disc_at(view, one.xy, motion) for one, motion in zip(expected, motions, strict=True)]
    _, pack = apart(discs)
    best = list(fits)
    again = together(view, [colours[k] for k in pack], [discs[k] for k in pack], "known")
    for k, fit in zip(pack, again, strict=True):
        if fit is not None and math.hypot(*(fit.xy - expected[k].xy)) < NEAR_RADII * fit.radius:
            best[k] = fit
    return best


def is_clear(fit: DiscFit | None) -> bool:
    """Whether a ball is so well seen that it need not be sought elsewhere."""
    return fit is not None and fit.residual < CLEAR_RESIDUAL


def known_disc(
    view: View, colour: Array | None, expected: Expected, sound: DiscFit | None, shutter: Shutter, own: Array | None,
    taken: Sequence[DiscFit],
) -> DiscFit | None:  # fmt: skip
    """A ball of this colour that is not clearly seen where it is expected; `taken` are other balls.

    `sound` is what is seen there after all. `own` (3,) is the colour of its face as it was seen, if it has several: of
    a ball that is swept far, no more is seen than their mean.
    """
    radius, last = view.geometry.radius(expected.xy), expected.xy - expected.step
    looks = [colour] if colour is not None or own is None else [None, own]
    fits = [sound]
    for look in looks:
        starts = [
            at for at in peaks(view, look, expected.xy, SEARCH_RADII * radius)
            if all(math.hypot(*(at - one.xy)) > radius for one in taken)
        ]  # fmt: skip
        ranked = [_ranked(view, look, at, at - last, radius, shutter) for at in starts]
        if sound is not None and len(looks) == 1:
            limit = sound.misfit - MISFIT_MARGIN  # what is farther away must be better
        else:
            limit = min([misfit for misfit, _ in ranked], default=math.inf) + RANKING_MARGIN
        hopeful = [(at, how) for at, (misfit, how) in zip(starts, ranked, strict=True) if misfit < limit]
        fits += [_best(view, look, at, at - last, radius, shutter, how) for at, how in hopeful]
    found = [fit for fit in fits if fit is not None and acceptable(fit, "known")]
    if sound is None or len(looks) > 1:
        swept = strips(view, looks[-1], last, radius, max(expected.max_move, SEARCH_RADII * radius), taken)
        far = [fit_disc(view, looks[-1], one.xy, radius, part * one.motion) for one in swept for part in TRIED_LENGTHS]
        error = 0.0 if looks[-1] is None else cover_sd(view, looks[-1], last)
        found += [fit for fit in far if fit is not None and acceptable(fit, "swept", error)]
    if not found:
        return None

    def away(fit: DiscFit) -> float:
        return math.hypot(*(fit.xy - expected.xy)) + radius * fit.misfit

    if own is not None and len(looks) > 1:  # other balls are found as well: the one that looks most like it is meant

        def cost(fit: DiscFit) -> float:
            place = (away(fit) / (NEAR_RADII * radius)) ** 2
            # Its place is of a Cauchy distribution over two dimensions, as it may have been hit.
            return face_cost(core_colour(view, fit) / 255, own / 255) + 1.5 * math.log1p(place)

        return min(found, key=cost)
    least = min(fit.misfit for fit in found)
    return min((fit for fit in found if fit.misfit < least + MISFIT_MARGIN), key=away)


def learn_shutter(shutter: Shutter, fit: DiscFit, expected: Expected, colour: Array | None) -> None:
    """Add to the shutter what a fit shows of it, if anything."""
    # A ball that has just been struck or has struck another did not move evenly: it does not show the exposure.
    moved = math.hypot(*(fit.xy - (expected.xy - expected.step)))
    even = expected.even and math.hypot(*(fit.xy - expected.xy)) < MAX_UNEVENNESS * moved
    if even and moved > MIN_SWEEP_RADII * fit.radius and len(shutter.tried(colour)) > 1:
        shutter.fractions.append(math.hypot(*fit.motion) / moved)
        if is_white(colour):
            shutter.gains.append(fit.gain)


def _best(
    view: View, colour: Array | None, at: Array, step: Array, radius: float, shutter: Shutter,
    how: tuple[float, float] | None = None,
) -> DiscFit | None:  # fmt: skip
    """The fit at a pixel (2,) with the motion that explains the picture best, among those of a fraction and gain."""
    if math.hypot(*step) < LEAST_SWEEP_RADII * radius:
        return fit_disc(view, colour, at, radius, np.zeros(2))
    tried = shutter.tried(colour)
    if how is None:
        how = tried[0] if len(tried) == 1 else _ranked(view, colour, at, step, radius, shutter)[1]
    best = _swept_disc(view, colour, at, step, radius, *how)
    if best is None or len(tried) > 1 or best.residual > CLEAR_RESIDUAL:
        still = fit_disc(view, colour, at, radius, np.zeros(2))
        if still is not None and (best is None or SWEEP_RATIO * still.misfit < best.misfit):
            return still
    return best


def _ranked(
    view: View, colour: Array | None, at: Array, step: Array, radius: float, shutter: Shutter
) -> tuple[float, tuple[float, float]]:
    """The misfit at a pixel (2,) after a few steps, and the fraction and gain of the swept disc that fits best then."""
    tried = shutter.tried(colour) if math.hypot(*step) >= LEAST_SWEEP_RADII * radius else [(0.0, 1.0)]
    fits = [fit_disc(view, colour, at, radius, part * step, gain, RANKING_STEPS) for part, gain in tried]
    misfits = [math.inf if fit is None else fit.misfit for fit in fits]
    best = int(np.argmin(misfits))
    still = None if tried[best][0] == 0.0 else fit_disc(view, colour, at, radius, np.zeros(2), steps=RANKING_STEPS)
    return min(misfits[best], math.inf if still is None else still.misfit), tried[best]


def _swept_disc(
    view: View, colour: Array | None, at: Array, step: Array, radius: float, part: float, gain: float
) -> DiscFit | None:
    """The fit at a pixel (2,) of a ball that moves by a part of its step, which the fit itself improves."""
    last, fit = at - step, fit_disc(view, colour, at, radius, part * step, gain)
    for _ in range(MAX_REFITS):
        if fit is None:
            break
        motion = part * (fit.xy - last)
        if math.hypot(*(motion - fit.motion)) < MAX_MOTION_ERROR_PX:
            break
        again = fit_disc(view, colour, fit.xy, radius, motion, gain)
        if again is None or again.misfit >= fit.misfit:
            break
        fit = again
    return fit


def core_colour(view: View, fit: DiscFit) -> Array:
    """Colour of the ball in the middle of a fit (3,) blue, green, red, less the table that shows through."""
    radius = CORE_RADII * fit.radius
    window, table, corner = view.window(fit.xy, radius)
    y, x = np.mgrid[: window.shape[0], : window.shape[1]]
    x, y = x + corner[0] - fit.xy[0], y + corner[1] - fit.xy[1]
    core = x * x + y * y < radius**2
    if not core.any():
        return np.full(3, np.nan)
    share = fit.gain * swept_share(x[core], y[core], fit.radius, fit.motion)
    return np.asarray(np.median(without_table(window[core], table[core], share), axis=0).clip(0, 255))
