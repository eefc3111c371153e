"""The detector: which balls are in a picture, and the centres of their outlines to a fraction of a pixel.

In: a camera, footage to learn from, and a palette; then pictures. Out: `Detection` of every ball. Learning means the
background, the colours of the balls, and the blur and edge noise of the optics. Not detected by its outline: a ball in
the middle of a pack, which has none against the cloth; by what it covers, it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from sysid.vision.balls.background import Background, View
from sysid.vision.balls.candidates import candidates
from sysid.vision.balls.colours.faces import ANY_BALL, face
from sysid.vision.balls.colours.names import STRAY_LIGHT, names_by_faces
from sysid.vision.balls.colours.palette import Palette, ball_colour, colour_distance
from sysid.vision.balls.cover import DiscFit
from sysid.vision.balls.discs import (
    Expected,
    Shutter,
    beside_others,
    core_colour,
    is_clear,
    known_disc,
    learn_shutter,
    near_disc,
    new_discs,
)
from sysid.vision.balls.edges import MIN_OUTLINE_RADIUS_PX, Optics
from sysid.vision.balls.outline_fit import (
    MIN_SEPARATION_RADII,
    OutlineFit,
    balls,
    fit_near,
    plausible,
)
from sysid.vision.balls.packs import disc_at, searched
from sysid.vision.balls.view_geometry import Array
from sysid.vision.camera.projection import Camera
from sysid.vision.sources.pictures import Picture

MAX_OFFSET_PX = 2.5  # from the expected centre, within which a detection is accepted at once
SEARCH_RADII = (2.5, 6.0)  # of the windows searched otherwise
MAX_COLOUR_DISTANCE = 0.22  # between colours of the same ball


@dataclass(frozen=True)
class Detection:
    """A ball detected in a picture."""

    name: str
    xy: Array  # (2,) centre of its outline [pixels]
    radius: float  # of its outline [pixels]
    sd: float  # standard deviation of the centre, per axis [pixels]
    coverage: float  # fraction of the outline that was seen
    score: float  # how well outline and colour fit, 0 to 1
    face_change: float = float("nan")  # of its face since the previous picture, 1 for noise alone
    colour: Array | None = None  # (3,) red, green, blue of its face in white light, 0 to 1
    odds: float = 1.0  # probability of the name beside that of the likeliest other one,
    other: str | None = None  # which is this
    motion: Array = field(default_factory=lambda: np.zeros(2))  # (2,) during the exposure [pixels]


@dataclass(frozen=True)
class Detector:
    """Detects the balls in pictures of one footage."""

    background: Background
    optics: Optics
    ball_colours: tuple[tuple[str, Array], ...]  # names, and colours in white light (3,) red, green, blue
    notes: tuple[str, ...]  # what was found, and warnings, for the user
    rough: bool = False  # whether edges are too rough for outlines, so that balls are measured by what they cover
    palette: Palette | None = None  # of balls that have several colours: these are found without names

    @property
    def camera(self) -> Camera:
        """Where it stands in the footage that the detector was learnt from."""
        return self.background.geometry.camera

    @property
    def noise(self) -> float:
        """Of the pictures, standard deviation [grey levels]."""
        return self.background.noise

    def find(
        self, picture: Picture, expected: Sequence[Expected] = (), shutter: Shutter | None = None,
        taken: Sequence[Detection] = (),
    ) -> list[Detection]:  # fmt: skip
        """Balls in a picture: those that are expected, or all but those found already."""
        view = self.background.view(picture)
        wanted = [one for one in expected if np.isfinite(one.xy).all()]
        if self.rough:
            return self._followed(view, wanted, shutter or Shutter()) if expected else self._discs(view, taken)
        if not expected:
            return self._outlines(view)
        found: list[Detection] = []
        fits = fit_near(view, self.optics, [one.xy for one in wanted])
        for one, fit in zip(wanted, fits, strict=True):
            ball = self._ball(view, one.name, fit, found)
            if ball is None or np.hypot(*(ball.xy - one.xy)) > MAX_OFFSET_PX:
                ball = self._around(view, one.name, one.xy, found)
            if ball is not None:
                found.append(ball)
        return found

    def named(self, picture: Picture, found: Sequence[Detection]) -> list[Detection]:
        """Detections under the names of their balls, as inferred from a single picture; those of no ball left out."""
        if self.palette is None:
            return list(found)
        view = self.background.view(picture)
        faces = {str(k): [face(self.background, view, one.xy, one.radius)] for k, one in enumerate(found)}
        _, naming = names_by_faces(faces, self.palette, self.background.bed_colour)
        each = zip(found, naming.names, naming.odds, naming.others, strict=True)
        return [replace(one, name=name, odds=odds, other=other) for one, name, odds, other in each if name is not None]

    def _outlines(self, view: View) -> list[Detection]:
        """All balls that are seen as outlines, the best first."""
        seen = [self._identified(view, fit) for fit in balls(view, self.optics)]
        return sorted((s for s in seen if s is not None), key=lambda s: -s.score)

    def _discs(self, view: View, known: Sequence[Detection]) -> list[Detection]:
        """All balls by what they cover, but for those found already."""
        taken = [disc_at(view, one.xy, one.motion) for one in known]
        found: list[Detection] = []
        if self.palette is not None:
            small = view.geometry.radius(np.array(self.camera.size) / 2) < MIN_OUTLINE_RADIUS_PX
            fits = new_discs(view, None, kind="small" if small else "new", taken=taken)
            return [self._unnamed(view, fit) for fit in fits]
        shown = searched(view)
        for name, colour in self.ball_colours:
            shown_at = partial(self._in_picture, view, colour)
            for fit in new_discs(view, self._in_picture(view, colour), shown_at, taken=taken, picture=shown):
                found += self._named_disc(view, name, fit, found)
        return found

    def _followed(self, view: View, expected: Sequence[Expected], shutter: Shutter) -> list[Detection]:
        """Expected balls by what they cover: those that are where they were expected, then the others elsewhere."""
        colours, found, taken = dict(self.ball_colours), list[Detection](), list[DiscFit]()
        known = [one for one in expected if one.name in colours or self.palette is not None]
        shown = [None if self.palette else self._in_picture(view, colours[one.name], one.xy) for one in known]
        near = [near_disc(view, colour, one.xy, one.step, shutter) for one, colour in zip(known, shown, strict=True)]
        near = beside_others(view, shown, known, near)
        clear_first = sorted(zip(known, shown, near, strict=True), key=lambda each: not is_clear(each[2]))
        for one, colour, fit in clear_first:
            if not is_clear(fit):
                own = None if one.colour is None else self._in_picture(view, one.colour, one.xy)
                fit = known_disc(view, colour, one, fit, shutter, own, taken)
            detection = self._named_disc(view, one.name, fit, found)
            if fit is not None and detection:
                learn_shutter(shutter, fit, one, colour)
                taken.append(fit)
                found += detection
        return found

    def _in_picture(self, view: View, colour: Array, pixel: Array | None = None) -> Array:
        """A colour in white light (3,) red, green, blue as a picture shows it (3,) blue, green, red [grey levels].

        In the light at a pixel (2,), or in that of the middle.
        """
        light = view.gain if pixel is None else self.background.light_at(view, pixel)
        return np.asarray((255 * colour[::-1] * light).clip(0, 255))

    def _named_disc(self, view: View, name: str, fit: DiscFit | None, found: Sequence[Detection]) -> list[Detection]:
        """The detection of a disc if its colour is that of this ball and it overlaps none of those found."""
        if fit is None or any(np.hypot(*(fit.xy - f.xy)) < MIN_SEPARATION_RADII * f.radius for f in found):
            return []
        if self.palette is not None:
            return [replace(self._unnamed(view, fit), name=name)]
        light = self.background.light_at(view, fit.xy)
        colours = np.array([colour for _, colour in self.ball_colours]).clip(0, 1 / light[::-1])
        measured = (core_colour(view, fit) / (255 * light))[::-1]
        distances = colour_distance(measured + STRAY_LIGHT, colours + STRAY_LIGHT)
        k = int(distances.argmin())
        if self.ball_colours[k][0] != name or distances[k] > MAX_COLOUR_DISTANCE:
            return []
        return [replace(self._unnamed(view, fit), name=name)]

    def _unnamed(self, view: View, fit: DiscFit) -> Detection:
        """The detection of a disc, of any ball."""
        colour = (core_colour(view, fit) / (255 * self.background.light_at(view, fit.xy)))[::-1]
        known = colour if np.isfinite(colour).all() else None
        score = fit.rim * (1 - fit.residual)
        return Detection(ANY_BALL, fit.xy, fit.radius, fit.sd, fit.rim, score, colour=known, motion=fit.motion)

    def _identified(self, view: View, fit: OutlineFit) -> Detection | None:
        """The detection of this outline; None if its colour is that of no ball."""
        if self.palette is not None:
            return Detection(ANY_BALL, fit.xy, fit.radius, fit.sd, fit.coverage, fit.coverage * fit.agreement)
        if not self.ball_colours:
            return None
        colours = np.array([colour for _, colour in self.ball_colours])
        distances = colour_distance(outline_colour(self.background, view, fit), colours)
        k = int(distances.argmin())
        if distances[k] > MAX_COLOUR_DISTANCE:
            return None
        score = fit.coverage * fit.agreement * float(np.exp(-0.5 * (distances[k] / MAX_COLOUR_DISTANCE) ** 2))
        return Detection(self.ball_colours[k][0], fit.xy, fit.radius, fit.sd, fit.coverage, score)

    def _ball(self, view: View, name: str, fit: OutlineFit | None, found: Sequence[Detection]) -> Detection | None:
        """The detection of this outline if it has this name and overlaps none of those found."""
        if fit is None or any(np.hypot(*(fit.xy - f.xy)) < MIN_SEPARATION_RADII * f.radius for f in found):
            return None
        seen = self._identified(view, fit) if plausible(view, fit) else None
        if seen is None or seen.name not in (name, ANY_BALL):
            return None
        return replace(seen, name=name)

    def _around(self, view: View, name: str, pixel: Array, found: Sequence[Detection]) -> Detection | None:
        """The ball of this name nearest to a pixel (2,), searched in a small window, then in a larger one."""
        for radii in SEARCH_RADII:
            starts = candidates(view, pixel, radii * view.geometry.radius(pixel))
            fits = fit_near(view, self.optics, starts)
            near = [ball for fit in fits if (ball := self._ball(view, name, fit, found)) is not None]
            if near:
                return min(near, key=lambda ball: float(np.hypot(*(ball.xy - pixel))))
        return None


def outline_colour(background: Background, view: View, fit: OutlineFit) -> Array:
    """Colour of the ball in an outline in white light: (3,) red, green, blue, 0 to 1."""
    return ball_colour(view.picture, fit.xy, fit.radius, background.light_at(view, fit.xy))
