"""The detector: which balls are in a picture, and the centres of their outlines to a fraction of a pixel.

In: a camera, footage to learn from, and a palette; then pictures. Out: `Detection` of every ball. Learning means the
background, the colours of the balls, and the blur and edge noise of the optics. Not detected: a ball in the middle of a
pack, which has no outline against the cloth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from models.errors import BadInput
from sysid.vision.balls.background import Background, View, learn_background
from sysid.vision.balls.candidates import candidates
from sysid.vision.balls.cover import DiscFit
from sysid.vision.balls.discs import CLIPPED_GREY, MIN_BED_CONTRAST, Shutter, core_colour, known_disc, new_discs
from sysid.vision.balls.edges import Optics
from sysid.vision.balls.outline_fit import (
    MIN_FOREGROUND,
    MIN_SEPARATION_RADII,
    OutlineFit,
    balls,
    fit_near,
    fit_outlines,
    plausible,
)
from sysid.vision.balls.palette import Palette, ball_colour, colour_distance, group_colours, name_colours
from sysid.vision.balls.view_geometry import Array, view_geometry
from sysid.vision.camera.projection import Camera
from sysid.vision.frames import Footage, Picture

MAX_OFFSET_PX = 2.5  # from the expected centre, within which a detection is accepted at once
SEARCH_RADII = (2.5, 6.0)  # of the windows searched otherwise
MAX_COLOUR_DISTANCE = 0.22  # between colours of the same ball
LEARNING_FRAMES = 30  # spread over the footage
MIN_FRAME_FRACTION = 0.1  # of these, that show a ball
STRAY_LIGHT = 0.05  # added to colours, whose dark channels compression falsifies
CLIPPED_FACTOR = 1.4  # by which its true brightness may exceed that
MIN_DISC_FRACTION = 0.3  # of the frames in which outlines have its colour, that show a disc of that colour, too
OPTICS_OUTLINES = 16  # the clearest ones, from which the optics are learnt
TRIED_BLURS_PX = (0.6, 0.72, 0.85, 1.0, 1.25, 1.6, 2.0, 2.6)  # of edges
BLUR_TEST_SPACING = 1.5  # of samples along normals, long enough to distinguish the blurs
# Before learning. Colour is often stored at half the resolution; a blur set too small for it would bias outlines.
INITIAL_EDGE_NOISE = (4.0, 6.0)  # in brightness and in colour [grey levels]
INITIAL_BLUR_PX = (0.85, 1.0)
INITIAL_SIZE_ERROR = 0.05  # of the radius, relative
MIN_EDGE_NOISE_GREY = 1.0
ROUGH_EDGE_RATIO = 4.0  # of edge noise to that of the pictures, from which on balls are measured by what they cover
MIN_HELD_FRACTION = 0.8  # of the balls that are seen as outlines, once the edges' noise is known, for these to be used
MIN_ROUGH_NOISE_GREY = 1.4  # that is assumed of pictures for this: compression removes noise
# Limits of warnings.
SIZE_WARNING_FRACTION = 0.04  # departure from the expected radius
SMALL_RADIUS_PX = 6.0
SOFT_EDGE_RATIO = 1.4  # blur of colour over that of brightness, or edge noise over picture noise
FLICKER_FRACTION = 0.03  # range of the light between frames
POOR_CENTRE_SD_PX = 0.15


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


@dataclass(frozen=True)
class Detector:
    """Detects the balls in pictures of one footage."""

    background: Background
    optics: Optics
    ball_colours: tuple[tuple[str, Array], ...]  # names, and colours in white light (3,) red, green, blue
    notes: tuple[str, ...]  # what was found, and warnings, for the user
    rough: bool = False  # whether edges are too rough for outlines, so that balls are measured by what they cover

    @property
    def noise(self) -> float:
        """Of the pictures, standard deviation [grey levels]."""
        return self.background.noise

    @staticmethod
    def learn(
        camera: Camera, footage: Footage, palette: Palette, progress: Callable[[str], None] = lambda line: None
    ) -> Detector:
        """Learn the background, the noise and the colours of the balls from frames spread over the footage.

        Raises:
            BadInput: the pictures have another size than those of the camera, or show no table.
        """
        if footage.size != camera.size:
            sizes = "{} x {} pixels, the camera's file {} x {}".format(*footage.size, *camera.size)
            raise BadInput(f"footage: has {sizes}; calibrate with pictures of this size")
        geometry = view_geometry(camera)
        if geometry.bed.sum() < 1000:
            raise BadInput("camera: no table is in its pictures; calibrate it anew")
        progress("learning what the empty table looks like")
        pictures = [frame.picture for frame in footage.sample(LEARNING_FRAMES)]
        size_sd = INITIAL_SIZE_ERROR * geometry.radius(np.array(camera.size) / 2)
        optics = Optics(INITIAL_EDGE_NOISE, INITIAL_BLUR_PX, size_sd=size_sd)
        background, resting = learn_background(
            geometry, pictures, lambda view: [fit.xy for fit in balls(view, optics, MIN_FOREGROUND)]
        )
        progress("learning what the balls look like")
        views = [background.view(picture) for picture in pictures]
        found = [(k, fit) for k, view in enumerate(views) for fit in balls(view, optics)]
        optics = _optics([(views[k], fit) for k, fit in found], optics)
        groups = group_colours([(k, _colour(background, views[k], fit)) for k, fit in found])
        frames_seen = [len({k for k, _ in group}) for group in groups]
        least = max(1, MIN_FRAME_FRACTION * len(views))
        frequent = [(group, n) for group, n in zip(groups, frames_seen, strict=True) if n >= least]
        colours = [np.median([colour for _, colour in group], axis=0) for group, _ in frequent]
        naming = name_colours(np.array(colours), palette)
        named = [(name, colour) for name, colour in zip(naming.names, colours, strict=True) if name is not None]
        counts = [(name, n) for name, (_, n) in zip(naming.names, frequent, strict=True) if name is not None]
        detector = Detector(background, optics, tuple(named), ())
        rough = len(found) >= OPTICS_OUTLINES and _rough(optics, background.noise)
        # How many outlines are seen again once the noise of edges is known.
        held = 0 if rough else sum(len(detector._outlines(view)) for view in views)
        if rough or held < max(MIN_HELD_FRACTION * sum(n for _, n in counts), OPTICS_OUTLINES):
            by_discs, disc_counts = _rough_detector(detector, pictures, counts)
            more = MIN_HELD_FRACTION * sum(n for _, n in disc_counts) > held
            if by_discs.ball_colours and (rough or more):
                detector, counts = by_discs, disc_counts
        notes = [f"{name}: in {n} of {len(views)} frames" for name, n in counts]
        notes += [doubt for doubt in naming.doubts if len(detector.ball_colours) == len(named)]
        lights = np.array([view.gain.mean() for view in views])
        notes += _warnings(detector, [fit for _, fit in found], resting, lights)
        return replace(detector, notes=tuple(notes))

    def find(
        self, picture: Picture, expected: Sequence[tuple[str, Array]] = (), steps: Sequence[Array] = (),
        shutter: Shutter | None = None,
    ) -> list[Detection]:  # fmt: skip
        """Balls in a picture: all of them, or those expected by name near pixels (2,).

        `steps` (2,) [pixels] are what the expected balls move from frame to frame, and `shutter` for how much of that.
        """
        view = self.background.view(picture)
        if self.rough:
            return self._discs(view, expected, steps, shutter or Shutter())
        if not expected:
            return self._outlines(view)
        found: list[Detection] = []
        wanted = [(name, np.asarray(pixel, float)) for name, pixel in expected if np.isfinite(pixel).all()]
        fits = fit_near(view, self.optics, [pixel for _, pixel in wanted])
        for (name, pixel), fit in zip(wanted, fits, strict=True):
            ball = self._ball(view, name, fit, found)
            if ball is None or np.hypot(*(ball.xy - pixel)) > MAX_OFFSET_PX:
                ball = self._around(view, name, pixel, found)
            if ball is not None:
                found.append(ball)
        return found

    def _outlines(self, view: View) -> list[Detection]:
        """All balls that are seen as outlines, the best first."""
        seen = [self._identified(view, fit) for fit in balls(view, self.optics)]
        return sorted((s for s in seen if s is not None), key=lambda s: -s.score)

    def _discs(
        self, view: View, expected: Sequence[tuple[str, Array]], steps: Sequence[Array], shutter: Shutter
    ) -> list[Detection]:  # fmt: skip
        """As `find`, by what the balls cover."""
        found: list[Detection] = []
        if not expected:
            for name, colour in self.ball_colours:
                for fit in new_discs(view, self._in_picture(view, colour)):
                    found += self._named_disc(view, name, fit, found) if self._on_bed(view, fit) else []
            return found
        reach, colours = SEARCH_RADII[-1], dict(self.ball_colours)
        for k, (name, pixel) in enumerate(expected):
            if np.isfinite(pixel).all() and name in colours:
                step = steps[k] if len(steps) else np.zeros(2)
                radius = view.geometry.radius(pixel)
                shown = self._in_picture(view, colours[name], pixel)
                one = known_disc(view, shown, pixel, step, reach * radius, shutter)
                found += self._named_disc(view, name, one, found)
        return found

    def _on_bed(self, view: View, fit: DiscFit) -> bool:
        """Whether a disc lies on the bed, clear of the pockets, which are discs themselves."""
        camera = view.geometry.camera
        xy = camera.on_plane(fit.xy[None], camera.radius)
        half = np.array([camera.table.length, camera.table.width]) / 2
        return bool((np.abs(xy) < half).all() and camera.table.to_pocket(xy)[0] > camera.diameter)

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
        light = self.background.light_at(view, fit.xy)
        colours = np.array([colour for _, colour in self.ball_colours]).clip(0, 1 / light[::-1])
        measured = (core_colour(view, fit) / (255 * light))[::-1]
        distances = colour_distance(measured + STRAY_LIGHT, colours + STRAY_LIGHT)
        k = int(distances.argmin())
        if self.ball_colours[k][0] != name or distances[k] > MAX_COLOUR_DISTANCE:
            return []
        return [Detection(name, fit.xy, fit.radius, fit.sd, fit.rim, fit.rim * (1 - fit.residual))]

    def _identified(self, view: View, fit: OutlineFit) -> Detection | None:
        """The detection of this outline; None if its colour is that of no ball."""
        if not self.ball_colours:
            return None
        colours = np.array([colour for _, colour in self.ball_colours])
        distances = colour_distance(_colour(self.background, view, fit), colours)
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
        return seen if seen is not None and seen.name == name else None

    def _around(self, view: View, name: str, pixel: Array, found: Sequence[Detection]) -> Detection | None:
        """The ball of this name nearest to a pixel (2,), searched in a small window, then in a larger one."""
        for radii in SEARCH_RADII:
            starts = candidates(view, pixel, radii * view.geometry.radius(pixel))
            fits = fit_near(view, self.optics, starts)
            near = [ball for fit in fits if (ball := self._ball(view, name, fit, found)) is not None]
            if near:
                return min(near, key=lambda ball: float(np.hypot(*(ball.xy - pixel))))
        return None


def _colour(background: Background, view: View, fit: OutlineFit) -> Array:
    return ball_colour(view.picture, fit.xy, fit.radius, background.light_at(view, fit.xy))


def _rough(optics: Optics, noise: float) -> bool:
    """Whether edges are far rougher than the noise, as compression and bloom make them, so that outlines mislead."""
    return max(optics.edge_noise) > ROUGH_EDGE_RATIO * max(noise, MIN_ROUGH_NOISE_GREY)


def _rough_detector(
    detector: Detector, pictures: Sequence[Picture], counts: Sequence[tuple[str, int]]
) -> tuple[Detector, list[tuple[str, int]]]:
    """A detector by what balls cover, of those colours that are seen as discs; and in how many pictures each is.

    Of clipped channels only a least brightness is known: they are taken as brighter, so that they are clipped anywhere.
    """
    table, geometry = detector.background.picture, detector.background.geometry
    bed = np.median(table[geometry.bed], axis=0)[::-1] / 255
    named = tuple(
        (name, colour) for name, colour in detector.ball_colours if colour_distance(colour, bed) > MIN_BED_CONTRAST
    )
    detector = replace(detector, rough=True, ball_colours=named)
    seen: dict[str, list[Array]] = {name: [] for name, _ in named}
    for picture in pictures:
        view = detector.background.view(picture)
        best = {one.name: one for one in detector.find(picture)[::-1]}
        for name, one in best.items():
            seen[name].append(
                core_colour(view, DiscFit(one.xy, one.radius, np.zeros(2), 1.0, one.sd, 0.0, 0.0, 1.0, 1.0))[::-1]
            )
    outlines = dict(counts)
    kept, found = [], []
    for name, colour in named:
        if len(seen[name]) >= MIN_DISC_FRACTION * outlines[name]:
            clipped = np.median(seen[name], axis=0) >= CLIPPED_GREY if seen[name] else np.zeros(3, bool)
            kept.append((name, np.where(clipped, CLIPPED_FACTOR, 1.0) * colour))
            found.append((name, len(seen[name])))
    return replace(detector, ball_colours=tuple(kept)), found


def _warnings(detector: Detector, found: Sequence[OutlineFit], resting: int, lights: Array) -> list[str]:
    """Warnings for the user."""
    optics, notes = detector.optics, []
    if not detector.ball_colours:
        notes.append("no ball was found: is this the camera of this footage, and are these its balls?")
        return notes
    radius = float(np.median([fit.radius for fit in found]))
    if abs(optics.size) > SIZE_WARNING_FRACTION * radius:
        percent = 100 * optics.size / radius
        notes.append(f"outlines are {percent:+.0f} % off the expected radius: check ball diameter and camera file")
    if radius < SMALL_RADIUS_PX:
        notes.append(f"balls are only {radius:.1f} pixels in radius, so their centres are poor: film at more pixels")
    noise = max(detector.noise, INITIAL_EDGE_NOISE[0])
    if optics.blur[1] > SOFT_EDGE_RATIO * optics.blur[0] or max(optics.edge_noise) > SOFT_EDGE_RATIO * noise:
        notes.append(
            "edges are rougher than the noise, as compression makes them: true errors may be twice the estimated"
        )
    if detector.rough:
        notes.append("balls are measured by what they cover, and their marks are not followed")
    if resting:
        notes.append(
            f"{resting} ball{'s' * (resting > 1)} at rest most of the time: the cloth below is taken from around it"
        )
    if np.ptp(lights) > FLICKER_FRACTION:
        notes.append(f"the light changes by {100 * np.ptp(lights):.0f} % between frames: allowed for")
    poor = [fit.sd for fit in found if fit.sd > POOR_CENTRE_SD_PX]
    if len(poor) > 0.05 * len(found):
        notes.append(
            f"of {len(poor)} of {len(found)} outlines the centre is only known to {np.median(poor):.2f} pixels"
        )
    return notes


def _optics(found: Sequence[tuple[View, OutlineFit]], optics: Optics) -> Optics:
    """Blurs and edge noise of lens and sensor, from the clearest outlines: the blurs with the least residual."""
    clean = sorted((f for f in found if np.isfinite(f[1].misfit)), key=lambda f: -f[1].quality)[:OPTICS_OUTLINES]

    def fitted(tried: Optics) -> list[tuple[View, OutlineFit]]:
        each = [(view, [fit.xy for v, fit in clean if v is view]) for view in {id(v): v for v, _ in clean}.values()]
        return [(view, fit) for view, at in each for fit in fit_outlines(view, tried, at) if fit is not None]

    def median_of(tried: Optics, of: Callable[[OutlineFit], float]) -> float:
        fits = fitted(tried)
        return float(np.median([of(fit) for _, fit in fits])) if 2 * len(fits) > len(clean) else np.inf

    if not clean:
        return replace(optics, size_sd=Optics.size_sd)
    # If the blur of colour is set too small, its edges seem to lie farther out. Along short normals every blur fits.
    pairs = []
    for light in TRIED_BLURS_PX:
        softer = [replace(optics, blur=(light, tint)) for tint in TRIED_BLURS_PX if tint >= light]
        pairs.append(min(softer, key=lambda tried: abs(median_of(tried, lambda fit: fit.between))))
    best = min(
        pairs, key=lambda tried: median_of(replace(tried, sample_spacing=BLUR_TEST_SPACING), lambda fit: fit.misfit)
    )
    optics = replace(optics, blur=best.blur)
    for size_sd in (optics.size_sd, optics.size_sd, Optics.size_sd):
        clean = fitted(optics) or clean
        edge_noise = np.maximum(np.median([fit.edge_noise for _, fit in clean], axis=0), MIN_EDGE_NOISE_GREY)
        size = float(np.median([fit.size for _, fit in clean]))
        optics = replace(optics, edge_noise=(float(edge_noise[0]), float(edge_noise[1])), size=size, size_sd=size_sd)
    return optics
