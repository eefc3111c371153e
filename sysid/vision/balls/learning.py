"""A detector learnt from footage: the empty table, the blur and noise of the optics, and the colours of the balls.

In: a camera, footage and a palette. Out: a `Detector` (detect.py), by outlines where these are sharp and steady, else
by what the balls cover.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from models.errors import BadInput
from models.messages import counted
from sysid.vision.balls.background import Background, View, learn_background
from sysid.vision.balls.colours.faces import are_patterned, face
from sysid.vision.balls.colours.names import name_colours
from sysid.vision.balls.colours.palette import LINK_DISTANCE, Palette, colour_distance, group_colours
from sysid.vision.balls.cover import CLIPPED_GREY, DiscFit
from sysid.vision.balls.detect import Detector, outline_colour
from sysid.vision.balls.discs import MIN_BED_CONTRAST, core_colour, is_disc, new_discs
from sysid.vision.balls.edges import MIN_OUTLINE_RADIUS_PX, Optics
from sysid.vision.balls.intruders import intruding, is_part
from sysid.vision.balls.outline_fit import OPTICS_OUTLINES, OutlineFit, balls, learn_optics
from sysid.vision.balls.resting import resting_balls
from sysid.vision.balls.view_geometry import Array, view_geometry
from sysid.vision.camera.camera_motion import standing
from sysid.vision.camera.projection import Camera
from sysid.vision.frames import Footage
from sysid.vision.sources.pictures import Picture

LEARNING_FRAMES = 30  # spread over the footage
MIN_FRAME_FRACTION = 0.1  # of these, that show a ball
CLEAREST, MAX_CLEAREST_RESIDUAL = 0.2, 0.22  # part of the discs of a colour, whose cover a ball explains so well
CLIPPED_FACTOR = 1.4  # by which the true brightness of a clipped channel may exceed what it shows
MIN_DISC_FRACTION = 0.3  # of the frames in which outlines have its colour, that show a disc of that colour, too
# Before learning. Colour is often stored at half the resolution; a blur set too small for it would bias outlines.
INITIAL_EDGE_NOISE = (4.0, 6.0)  # in brightness and in colour [grey levels]
INITIAL_BLUR_PX = (0.85, 1.0)
INITIAL_SIZE_ERROR = 0.05  # of the radius, relative
ROUGH_EDGE_RATIO = 4.0  # of edge noise to that of the pictures, from which on balls are measured by what they cover
MIN_HELD_FRACTION = 0.8  # of the balls that are seen as outlines, once the edges' noise is known, for these to be used
MAX_UNSTEADY_PX = 0.08  # of balls at rest by their outlines, from which on discs are tried, and taken if they are
MAX_STEADY_RATIO = 0.6  # by this factor, or at all and seen more often
MAX_RESTING_MOVE_PX = 1.5  # between pictures of a ball at rest
MIN_RESTING_PICTURES = 3
MIN_ROUGH_NOISE_GREY = 1.4  # that is assumed of pictures for this: compression removes noise
# Limits of warnings.
SIZE_WARNING_FRACTION = 0.04  # departure from the expected radius
SMALL_RADIUS_PX = 6.0
SOFT_EDGE_RATIO = 1.4  # blur of colour over that of brightness, or edge noise over picture noise
FLICKER_FRACTION = 0.03  # range of the light between frames
POOR_CENTRE_SD_PX = 0.15


def learn_detector(
    camera: Camera, footage: Footage, palette: Palette, progress: Callable[[str], None] = lambda line: None
) -> Detector:
    """Learn the background, the noise and the colours of the balls from frames spread over the footage.

    The camera may have been bumped since it was calibrated: the detector has the one that stands where it does now.
    Balls of a palette of several colours each are taken as plain where all that are seen show one.

    Raises:
        BadInput: the pictures have another size than those of the camera, show no table, or show it elsewhere.
    """
    if footage.size != camera.size:
        sizes = "{} x {} pixels, the camera's file {} x {}".format(*footage.size, *camera.size)
        raise BadInput(f"footage: has {sizes}; calibrate with pictures of this size")
    progress("estimating the background")
    pictures = [frame.picture for frame in footage.sample(LEARNING_FRAMES)]
    try:
        camera, moved = standing(camera, pictures)
    except BadInput as error:
        raise BadInput(f"{footage.name}: {error}") from None
    geometry = view_geometry(camera)
    if geometry.bed.sum() < 1000:
        raise BadInput("camera: its pictures do not show the table; calibrate it again")
    size_sd = INITIAL_SIZE_ERROR * geometry.radius(np.array(camera.size) / 2)
    optics = Optics(INITIAL_EDGE_NOISE, INITIAL_BLUR_PX, size_sd=size_sd)

    background, resting = learn_background(
        geometry, pictures, lambda view: resting_balls(view, optics, palette), intruding
    )
    progress("estimating the colours of the balls")
    views = [background.view(picture) for picture in pictures]
    found = [(k, fit) for k, view in enumerate(views) for fit in _no_arms(view, balls(view, optics))]
    small = geometry.radius(np.array(camera.size) / 2) < MIN_OUTLINE_RADIUS_PX
    if small:
        found = [(k, fit) for k, fit in found if is_disc(views[k], fit.xy, patterned=palette.patterned)] or found
    optics = learn_optics([(views[k], fit) for k, fit in found], optics)
    lights = np.array([view.gain.mean() for view in views])
    if palette.patterned and are_patterned(
        [face(background, view, one.xy, one.radius) for view in views[::3] for one in new_discs(view, None)]
    ):
        detector, notes = _patterned_detector(background, optics, palette, pictures, small)
        return replace(
            detector, notes=(*moved, *notes, *_warnings(detector, [fit for _, fit in found], resting, lights))
        )
    groups = group_colours([(k, outline_colour(background, views[k], fit)) for k, fit in found])
    frames_seen = [len({k for k, _ in group}) for group in groups]
    least = max(1, MIN_FRAME_FRACTION * len(views))
    frequent = [(group, n) for group, n in zip(groups, frames_seen, strict=True) if n >= least]
    colours = [np.median([colour for _, colour in group], axis=0) for group, _ in frequent]
    naming = name_colours(np.array(colours), palette, background.bed_colour)
    named = [(name, colour) for name, colour in zip(naming.names, colours, strict=True) if name is not None]
    counts = [(name, n) for name, (_, n) in zip(naming.names, frequent, strict=True) if name is not None]
    detector = Detector(background, optics, tuple(named), ())
    rough = len(found) >= OPTICS_OUTLINES and (small or _rough(optics, background.noise))
    detector, counts = _outlines_or_discs(detector, pictures, views, counts, rough)
    notes = [f"{name}: seen in {n} of {len(views)} sampled frames" for name, n in counts]
    notes += [doubt for doubt in naming.doubts if len(detector.ball_colours) == len(named)]
    notes += _warnings(detector, [fit for _, fit in found], resting, lights)
    return replace(detector, notes=(*moved, *notes))


def _outlines_or_discs(
    detector: Detector, pictures: Sequence[Picture], views: Sequence[View], counts: list[tuple[str, int]], rough: bool
) -> tuple[Detector, list[tuple[str, int]]]:
    """The detector that sees balls by their outlines, or one by discs where these are seen more often or are steadier.

    `counts`: in how many pictures each ball is seen by its outline; those of the detector that is taken go with it.
    `rough`: whether edges are too rough for outlines, whatever these show.
    """
    # How many outlines are seen again once the noise of edges is known.
    held = 0 if rough else sum(len(detector._outlines(view)) for view in views)
    unsteady = 0.0 if rough else unsteadiness(detector, pictures)
    few = held < max(MIN_HELD_FRACTION * sum(n for _, n in counts), OPTICS_OUTLINES)
    if not (rough or few or unsteady > MAX_UNSTEADY_PX):
        return detector, counts
    by_discs, disc_counts = _rough_detector(detector, pictures, counts)
    seen = sum(n for _, n in disc_counts)
    better = MIN_HELD_FRACTION * seen > held
    if unsteady > MAX_UNSTEADY_PX and not better:
        same = {name for name, _ in by_discs.ball_colours} == {name for name, _ in detector.ball_colours}
        better = same and steadier(unsteadiness(by_discs, pictures), unsteady, more=seen > held)
    return (by_discs, disc_counts) if by_discs.ball_colours and (rough or better) else (detector, counts)


def _no_arms(view: View, found: Sequence[OutlineFit]) -> list[OutlineFit]:
    """The outlines without those of pieces of an arm, which no ball beside them explains."""
    intruders, kept = intruding(view), list[OutlineFit]()
    while more := [
        fit for fit in found
        if all(fit is not one for one in kept) and not is_part(intruders, view, fit.xy, [one.xy for one in kept])
    ]:  # fmt: skip
        kept += more
    return kept


def _patterned_detector(
    background: Background, optics: Optics, palette: Palette, pictures: Sequence[Picture], small: bool
) -> tuple[Detector, list[str]]:
    """A detector of balls that have several colours, and what it sees.

    By outlines where these are seen as often, but for `small` balls, in whose outlines a cue or a sleeve fits as well.
    """
    by_discs = Detector(background, optics, (), (), rough=True, palette=palette)
    chosen, seen = by_discs, [len(by_discs.find(picture)) for picture in pictures]
    if not (small or _rough(optics, background.noise)):
        outlines = replace(by_discs, rough=False)
        held = [len(outlines.find(picture)) for picture in pictures]
        if sum(held) >= max(MIN_HELD_FRACTION * sum(seen), OPTICS_OUTLINES):
            chosen, seen = outlines, held
    return chosen, [f"balls per frame: {np.median(seen):.0f} (median), named by their faces"]


def _rough(optics: Optics, noise: float) -> bool:
    """Whether edges are far rougher than the noise, as compression and bloom make them, so that outlines mislead."""
    return max(optics.edge_noise) > ROUGH_EDGE_RATIO * max(noise, MIN_ROUGH_NOISE_GREY)


def _rough_detector(
    detector: Detector, pictures: Sequence[Picture], counts: Sequence[tuple[str, int]]
) -> tuple[Detector, list[tuple[str, int]]]:
    """A detector by what balls cover, of those colours that are seen as discs; and in how many pictures each is.

    Of clipped channels only a least brightness is known: they are taken as brighter, so that they are clipped anywhere.
    """
    bed = detector.background.bed_colour
    named = tuple(
        (name, colour) for name, colour in detector.ball_colours if colour_distance(colour, bed) > MIN_BED_CONTRAST
    )
    detector = replace(detector, rough=True, ball_colours=named)
    seen: dict[str, list[Array]] = {name: [] for name, _ in named}
    residuals: dict[str, list[float]] = {name: [] for name, _ in named}
    for picture in pictures:
        view = detector.background.view(picture)
        best = {one.name: one for one in detector.find(picture)[::-1]}
        for name, one in best.items():
            residuals[name].append(1 - one.score / one.coverage)
            seen[name].append(
                core_colour(view, DiscFit(one.xy, one.radius, np.zeros(2), 1.0, one.sd, 0.0, 0.0, 1.0, 1.0))[::-1]
            )
    outlines = dict(counts)
    kept = []
    for name, colour in named:
        shaped = bool(seen[name]) and np.quantile(residuals[name], CLEAREST) <= MAX_CLEAREST_RESIDUAL
        if shaped and len(seen[name]) >= MIN_DISC_FRACTION * outlines[name]:
            clipped = np.median(seen[name], axis=0) >= CLIPPED_GREY
            kept.append((name, np.where(clipped, CLIPPED_FACTOR, 1.0) * colour))
    found = {name: len(seen[name]) for name, _ in kept}
    kept = distinct(kept, found)
    return replace(detector, ball_colours=tuple(kept)), [(name, found[name]) for name, _ in kept]


def distinct(colours: Sequence[tuple[str, Array]], seen: Mapping[str, int]) -> list[tuple[str, Array]]:
    """Names and colours (3,) that pictures can distinguish; of those that look alike when clipped, the one seen most.

    A hand or a cue beside an overexposed ball may have given another colour, which a picture shows as the same white.
    """
    kept: list[tuple[str, Array]] = []
    for name, colour in sorted(colours, key=lambda one: -seen[one[0]]):
        if all(colour_distance(colour.clip(0, 1), other.clip(0, 1)) > LINK_DISTANCE for _, other in kept):
            kept.append((name, colour))
    names = {name for name, _ in kept}
    return [(name, colour) for name, colour in colours if name in names]


def steadier(discs: float, outlines: float, *, more: bool) -> bool:
    """Whether discs are to be taken by how much balls at rest differ by discs and by outlines [pixels].

    Where they are seen in `more` pictures it is enough that they are steadier; else they must be far steadier.
    """
    return discs < (1.0 if more else MAX_STEADY_RATIO) * outlines


def unsteadiness(detector: Detector, pictures: Sequence[Picture]) -> float:
    """By how much the places of balls at rest differ between pictures, rms per axis [pixels]; 0 where none rests."""
    places: list[list[Array]] = []
    for picture in pictures:
        for one in detector.find(picture):
            near = [seen for seen in places if np.hypot(*(one.xy - np.median(seen, axis=0))) < MAX_RESTING_MOVE_PX]
            if near:
                near[0].append(one.xy)
            else:
                places.append([one.xy])
    off = [np.array(seen) - np.median(seen, axis=0) for seen in places if len(seen) >= MIN_RESTING_PICTURES]
    return float(np.sqrt(np.mean(np.concatenate(off) ** 2))) if off else 0.0


def _warnings(detector: Detector, found: Sequence[OutlineFit], resting: int, lights: Array) -> list[str]:
    """Warnings for the user."""
    optics, notes = detector.optics, []
    if not found or not (detector.ball_colours or detector.palette):
        notes.append("no ball was found: check that the camera file and the palette belong to this footage")
        return notes
    radius = float(np.median([fit.radius for fit in found]))
    if abs(optics.size) > SIZE_WARNING_FRACTION * radius:
        percent = 100 * optics.size / radius
        notes.append(f"outlines are {percent:+.0f} % off the expected radius: check ball diameter and camera file")
    if radius < SMALL_RADIUS_PX:
        notes.append(f"balls have a radius of {radius:.1f} pixels only: for accurate centres film at more pixels")
    noise = max(detector.noise, INITIAL_EDGE_NOISE[0])
    if optics.blur[1] > SOFT_EDGE_RATIO * optics.blur[0] or max(optics.edge_noise) > SOFT_EDGE_RATIO * noise:
        notes.append(
            "edges are rougher than noise makes them, as after compression: errors may be twice those estimated"
        )
    if detector.rough:
        notes.append("balls are located by the area that they cover; marks on them are not tracked")
    if resting:
        notes.append(
            f"{counted(resting, 'ball')} at rest most of the time: the cloth beneath is interpolated from around"
        )
    if np.ptp(lights) > FLICKER_FRACTION:
        notes.append(f"the brightness varies by {100 * np.ptp(lights):.0f} % between frames: corrected for")
    poor = [fit.sd for fit in found if fit.sd > POOR_CENTRE_SD_PX]
    if len(poor) > 0.05 * len(found):
        notes.append(
            f"the centres of {len(poor)} of {len(found)} outlines are uncertain by {np.median(poor):.2f} pixels"
        )
    return notes
