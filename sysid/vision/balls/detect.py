"""Balls in single pictures: which, and where the centres of their outlines are, to a fraction of a pixel.

A ball is where the outline that the camera expects there fits: along every normal to it the picture is the ball's
colour within and the empty table's without, darkened at will. Where one becomes the other is a linear least squares
problem (palette.py), and the outline is shifted, as one piece, to where most normals agree. Normals that end on
something else than the table (another ball, the cue, a hand) do not count. Balls that move are also fitted as drawn out
along their way. What is not found: a ball in the middle of a pack, which has no outline against the cloth.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from sysid.vision.balls.backdrop import Array, Backdrop, View, candidates, empty_table, scene_of, smeared
from sysid.vision.balls.palette import OUTER, Optics, Palette, apart, ball_colour, edges_of, grouped, name_colours
from sysid.vision.camera.projection import Camera
from sysid.vision.frames import Footage, Picture

ROUNDS, STEPS = 8, 5  # of fitting anew at the place found, and of weighing normals anew
SETTLED, UNSETTLED = 0.1, 0.25  # last shift that ends it, and that shows that there is nothing to find [pixels]
FLOOR = 0.12  # what the light on balls does to a single normal's edge, one standard deviation [pixels]
MISFIT = 0.02  # what is left of the cloth's colour beside a ball, in parts of it
TUKEY = 4.7  # where an edge's weight vanishes, in robust standard deviations
SEEN, FEWEST = 0.6, 8  # standard deviation of an edge that counts as seen [pixels]; how few such make an outline
COVERAGE, AGREEMENT, SURE = 0.3, 0.6, 0.5  # the least of an outline, the least agreement, and the largest sd [pixels]
FULL, FILLED, DISC = 0.7, 0.5, 0.8  # coverage from which on a ball need not fill so much of such a part of its radius
APART = 1.3  # radii between two balls' centres, at least
DOUBTFUL, CLEAR = 4.0, 0.1  # quality below which other ways are tried; scatter than which none is better [pixels]
TRIED, WAYS, ASTRAY = 10, 6, 0.3  # guesses tried in other ways; places about each; how far off [radii]
MOST, MOST_AGREE, UNUSUAL = 0.6, 0.9, 2.2  # coverage, agreement, and roughness in usual ones, that leave no doubt
LOOSELY, DRAWN = 0.22, (0.75, 0.9, 1.1)  # scatter from which on smears are tried [pixels], and in which parts
CLEARLY = 1.1  # quality over another's, of what takes its place
BLOB, VAGUE = 0.35, (0.1, 0.02)  # smear [radii] whose middle may be better than an outline; its sd [pixels], and growth
NEAR, REACHES = 2.5, (2.5, 6.0)  # from an expected place: what is taken at once [pixels], windows searched [radii]
LOOK = 0.22  # distance of colours that can be the same ball's
SAMPLES, OFTEN = 30, 0.1  # frames to learn from, and the part of them that shows a ball
CLEAN = 16  # outlines to learn the optics from
BLURS = (0.6, 0.72, 0.85, 1.0, 1.25, 1.6, 2.0, 2.6)  # of edges, that are tried [pixels]
LONG = 1.5  # stretch at which they can be told
# Noise of edges in brightness and colour [grey levels], and their blur [pixels], before they are known: colour is often
# kept at half the resolution, and taken for too sharp it draws outlines astray.
ROUGH, SOFTER = (4.0, 6.0), (0.85, 1.0)
SMOOTHEST = 1.0  # the least noise of edges [grey levels]
LOOSE = 0.05  # by which the radius may be off before it is known, in parts
# What is told of: departures in size, small radii [pixels], soft or rough edges, changing light, poor centres [pixels].
WRONG_SIZE, SMALL, SOFT, FLICKER, POOR = 0.04, 6.0, 1.4, 0.03, 0.15


@dataclass(frozen=True)
class Seen:
    """A ball in a picture."""

    name: str
    xy: Array  # (2,) centre of its outline [pixels]
    radius: float  # of its outline [pixels]
    sd: float  # estimated error of the centre, one standard deviation per axis [pixels]
    coverage: float  # part of the outline that was seen, 0 to 1
    score: float  # how well outline and colour fit, 0 to 1
    change: float = float("nan")  # of its face since the picture before, 1 for noise alone


@dataclass(frozen=True)
class Fit:
    """An outline that was shifted to where the picture shows one."""

    xy: Array  # (2,) centre [pixels]
    radius: float  # [pixels]
    size: float  # beyond the expected radius [pixels]
    sd: float  # of the centre per axis [pixels]
    coverage: float = 1.0  # part of the outline that was seen and agrees
    agreement: float = 1.0  # part of what could be seen, having the table beyond, that was and agrees
    scatter: float = 0.0  # of the edges about it, one standard deviation [pixels]
    rest: float = np.inf  # mean square of what is left of brightness along its normals [grey levels squared]
    between: float = 0.0  # radius of the edges in colour less that of those in brightness [pixels]
    rough: tuple[float, float] = (np.inf, np.inf)  # noise that would scatter edges in brightness and colour as they do

    @property
    def quality(self) -> float:
        """How much it is to be preferred to another outline of the same ball."""
        return self.coverage * self.agreement / max(self.scatter, CLEAR)

    def doubtful(self, optics: Optics) -> bool:
        """Whether it may be badly placed: it is poor, and not because pictures are."""
        if self.quality > DOUBTFUL:
            return False
        usual = all(own < UNUSUAL * known for own, known in zip(self.rough, optics.rough, strict=True))
        return not (usual and self.coverage > MOST and self.agreement > MOST_AGREE)


def _agreed(
    normals: Array, move: Array, var: Array, ok: NDArray[np.bool_], optics: Optics
) -> tuple[Array, Array, Array]:
    """Shift and growth (m, 3) on which most normals of an outline agree, covariances (m, 3, 3), weights (m, RAYS)."""
    x = np.concatenate([normals, np.ones((*move.shape, 1))], axis=2)
    known = np.diag([1e-3, 1e-3, optics.give**-2])
    weight, root = ok.astype(float), np.sqrt(var)
    middle = np.maximum(ok.sum(axis=1, keepdims=True) - 1, 0) // 2
    for _ in range(STEPS):
        pulls = (x * (weight / var)[..., None]).transpose(0, 2, 1)
        cov = np.linalg.inv(pulls @ x + known)
        p = cov @ (pulls @ move[..., None])
        off = np.abs(move - (x @ p)[..., 0]) / root
        scale = 1.48 * np.take_along_axis(np.sort(np.where(ok, off, np.inf), axis=1), middle, axis=1)
        scale = np.where(np.isfinite(scale), np.maximum(scale, 1.0), 1.0)
        weight = ok * np.maximum(0.0, 1 - (off / (TUKEY * scale)) ** 2) ** 2
    return p[..., 0], cov * scale[..., None] ** 2, weight


def fit_outlines(
    view: View, optics: Optics, starts: Sequence[Array], smears: Sequence[Array] | None = None
) -> list[Fit | None]:
    """Shift the expected outlines from first guesses (2,) [pixels] to where the picture shows them; None if nowhere.

    `smears` (2,) [pixels] are the ways that balls go during the exposure, if any.
    """
    if len(starts) == 0:
        return []
    centres = np.array(starts, float).reshape(-1, 2)
    ways = np.zeros_like(centres) if smears is None else np.array(smears, float).reshape(-1, 2)
    for _ in range(ROUNDS):
        shapes = [view.scene.outline(c) for c in centres]
        offsets, normals, heights = (np.stack(v) for v in zip(*shapes, strict=True))
        edges = edges_of(view, optics, centres[:, None] + offsets + optics.size * normals, normals, heights, ways)
        left = sum(r / v**2 for r, v in zip(edges.rest, optics.rough, strict=True))
        odd = np.maximum(1.0, left / np.maximum(np.median(left, axis=1, keepdims=True), 1.0) / 1.2) ** 2
        alone = (1 + (MISFIT * edges.bright / optics.rough[0]) ** 2) / edges.hold
        move = edges.move.clip(-OUTER, OUTER)
        shift, cov, weight = _agreed(normals, move, odd * (alone + FLOOR**2), edges.clear, optics)
        centres = centres + shift[:, :2].clip(-OUTER, OUTER)
        if np.abs(shift[:, :2]).max() < SETTLED:
            break
    agree = edges.clear & (alone < SEEN**2) & (weight > 0.3)
    # What is left of the cloth's colour shifts a whole side, the more the less ball and cloth differ.
    common = (MISFIT / 2 * edges.bright[:, 0] / optics.rough[0]) ** 2 / np.median(edges.hold, axis=1)
    sd = np.sqrt((cov[:, 0, 0] + cov[:, 1, 1]) / 2 + common)
    model = np.einsum("mrk,mk->mr", normals, shift[:, :2]) + shift[:, 2:]
    found: list[Fit | None] = []
    for k, on in enumerate(agree):
        if on.sum() < FEWEST or np.abs(shift[k, :2]).max() > UNSETTLED:
            found.append(None)
            continue
        size = float(optics.size + shift[k, 2])
        radius = float(np.linalg.norm(offsets[k], axis=1).mean()) + size
        light, tint = (1.48 * float(np.median((np.abs(e - model) * np.sqrt(v))[k, on])) for e, v in edges.each)
        found.append(
            Fit(
                centres[k], radius, size, float(sd[k]), float(on.mean()), float(on.sum() / edges.clear[k].sum()),
                1.48 * float(np.median(np.abs(move - model)[k, on])), float(np.median(edges.rest[0][k, on])),
                float(np.median((edges.each[1][0] - edges.each[0][0])[k, on])), (light, tint),
            )
        )  # fmt: skip
    return found


def fit_near(view: View, optics: Optics, starts: Sequence[Array]) -> list[Fit | None]:
    """As `fit_outlines`, of guesses a few pixels off and balls that move: what is badly found is tried otherwise."""
    best = fit_outlines(view, optics, starts)
    owners: list[int] = []
    tries: list[tuple[Array, Array]] = []
    for k in [k for k, fit in enumerate(best) if fit is None or fit.doubtful(optics)][:TRIED]:
        fit, radius = best[k], view.scene.radius(starts[k])
        moved = smeared(view, starts[k]) if fit is None or fit.scatter > LOOSELY else None
        if moved is not None:
            middle, way, alike = moved
            long = float(np.hypot(*way))
            if alike and long > BLOB * radius:
                sd = VAGUE[0] + VAGUE[1] * long
                best[k] = _better(best[k], Fit(middle, radius, 0.0, sd, scatter=VAGUE[0] + sd))
            more = [(middle, part * way) for part in DRAWN]
        else:
            angles = np.arange(WAYS) * 2 * np.pi / WAYS
            more = [(starts[k] + ASTRAY * radius * np.array([np.cos(a), np.sin(a)]), np.zeros(2)) for a in angles]
        owners, tries = owners + [k] * len(more), tries + more
    for k, fit in zip(owners, fit_outlines(view, optics, *zip(*tries, strict=True)) if tries else [], strict=True):
        best[k] = _better(best[k], fit)
    return best


def _better(one: Fit | None, other: Fit | None) -> Fit | None:
    """The first, unless the other is clearly better."""
    return other if other and (one is None or other.quality > CLEARLY * one.quality) else one


def plausible(view: View, fit: Fit | None, coverage: float = COVERAGE) -> bool:
    """Whether an outline can be a ball's: seen well enough, and filled unless nearly all of it is seen."""
    if fit is None or fit.coverage < coverage or fit.agreement < AGREEMENT or fit.sd > SURE:
        return False
    return fit.coverage > FULL or view.filled(fit.xy, DISC * fit.radius) > FILLED


def balls(view: View, optics: Optics, coverage: float = COVERAGE) -> list[Fit]:
    """All outlines in a picture that may be balls', none on another."""
    kept: list[Fit] = []
    fits = [fit for fit in fit_near(view, optics, candidates(view)) if fit and plausible(view, fit, coverage)]
    for fit in sorted(fits, key=lambda f: -f.quality):
        if all(np.hypot(*(fit.xy - k.xy)) > APART * k.radius for k in kept):
            kept.append(fit)
    return kept


@dataclass(frozen=True)
class Detector:
    """Finds the balls of one footage."""

    backdrop: Backdrop
    optics: Optics
    looks: tuple[tuple[str, Array], ...]  # names of balls and their colours in white light: (3,) red, green, blue
    told: tuple[str, ...]  # what was found, and what is not to be trusted, in plain words

    @property
    def noise(self) -> float:
        """Of the pictures, one standard deviation [grey levels]."""
        return self.backdrop.noise

    @staticmethod
    def learn(
        camera: Camera, footage: Footage, palette: Palette, progress: Callable[[str], None] = lambda line: None
    ) -> Detector:
        """Learn the empty table, the noise and the balls' colours from frames spread over the footage.

        Raises:
            BadInput: the pictures are not those of the camera, or show no table.
        """
        if footage.size != camera.size:
            sizes = "{} x {} pixels, the camera's file {} x {}".format(*footage.size, *camera.size)
            raise BadInput(f"footage: has {sizes}; calibrate with pictures of this size")
        scene = scene_of(camera)
        if scene.bed.sum() < 1000:
            raise BadInput("camera: sees no table in its pictures; calibrate it anew")
        progress("learning what the empty table looks like")
        pictures = [frame.picture for frame in footage.sample(SAMPLES)]
        optics = Optics(ROUGH, SOFTER, give=LOOSE * scene.radius(np.array(camera.size) / 2))
        backdrop, resting = empty_table(scene, pictures, lambda view: [fit.xy for fit in balls(view, optics, FILLED)])
        progress("learning what the balls look like")
        views = [backdrop.view(picture) for picture in pictures]
        found = [(k, fit) for k, view in enumerate(views) for fit in balls(view, optics)]
        optics = _optics([(views[k], fit) for k, fit in found], optics)
        groups = grouped([(k, _colour(backdrop, views[k], fit)) for k, fit in found])
        often = [len({k for k, _ in group}) for group in groups]
        seen = [(group, n) for group, n in zip(groups, often, strict=True) if n >= max(1, OFTEN * len(views))]
        looks = [np.median([colour for _, colour in group], axis=0) for group, _ in seen]
        naming = name_colours(np.array(looks), palette)
        named = [(name, look) for name, look in zip(naming.names, looks, strict=True) if name is not None]
        counts = [(name, n) for name, (_, n) in zip(naming.names, seen, strict=True) if name is not None]
        told = [f"{name}: in {n} of {len(views)} frames" for name, n in counts]
        told += naming.doubts
        learnt = Detector(backdrop, optics, tuple(named), ())
        lights = np.array([view.gain.mean() for view in views])
        told += _troubles(learnt, [fit for _, fit in found], resting, lights)
        return replace(learnt, told=tuple(told))

    def find(self, picture: Picture, expected: Sequence[tuple[str, Array]] = ()) -> list[Seen]:
        """Balls in a picture: all, or of those that are expected, by name, near pixels (2,), all that are there."""
        view = self.backdrop.view(picture)
        if not expected:
            seen = [self._named(view, fit) for fit in balls(view, self.optics)]
            return sorted((s for s in seen if s is not None), key=lambda s: -s.score)
        found: list[Seen] = []
        wanted = [(name, np.asarray(place, float)) for name, place in expected if np.isfinite(place).all()]
        fits = fit_near(view, self.optics, [place for _, place in wanted])
        for (name, place), fit in zip(wanted, fits, strict=True):
            ball = self._ball(view, name, fit, found)
            if ball is None or np.hypot(*(ball.xy - place)) > NEAR:
                ball = self._around(view, name, place, found)
            if ball is not None:
                found.append(ball)
        return found

    def _named(self, view: View, fit: Fit) -> Seen | None:
        """The ball of this outline; None if it has the colour of none."""
        if not self.looks:
            return None
        far = apart(_colour(self.backdrop, view, fit), np.array([look for _, look in self.looks]))
        k = int(far.argmin())
        if far[k] > LOOK:
            return None
        score = fit.coverage * fit.agreement * float(np.exp(-0.5 * (far[k] / LOOK) ** 2))
        return Seen(self.looks[k][0], fit.xy, fit.radius, fit.sd, fit.coverage, score)

    def _ball(self, view: View, name: str, fit: Fit | None, found: Sequence[Seen]) -> Seen | None:
        """The ball of this outline if it has this name and is none of those found."""
        if fit is None or any(np.hypot(*(fit.xy - f.xy)) < APART * f.radius for f in found):
            return None
        seen = self._named(view, fit) if plausible(view, fit) else None
        return seen if seen is not None and seen.name == name else None

    def _around(self, view: View, name: str, place: Array, found: Sequence[Seen]) -> Seen | None:
        """The ball of this name nearest to a place, in a small window or a larger one."""
        for reach in REACHES:
            starts = candidates(view, place, reach * view.scene.radius(place))
            fits = fit_near(view, self.optics, starts)
            near = [ball for fit in fits if (ball := self._ball(view, name, fit, found)) is not None]
            if near:
                return min(near, key=lambda ball: float(np.hypot(*(ball.xy - place))))
        return None


def _colour(backdrop: Backdrop, view: View, fit: Fit) -> Array:
    return ball_colour(view.picture, fit.xy, fit.radius, backdrop.lamp(view, fit.xy))


def _troubles(learnt: Detector, found: Sequence[Fit], resting: int, lights: Array) -> list[str]:
    """What is not to be trusted, in plain words."""
    optics, told = learnt.optics, []
    if not learnt.looks:
        told.append("no ball was found: is this the camera of this footage, and are these its balls?")
        return told
    radius = float(np.median([fit.radius for fit in found]))
    if abs(optics.size) > WRONG_SIZE * radius:
        told.append(
            f"outlines are {100 * optics.size / radius:+.0f} % off the expected radius: see to diameter and camera"
        )
    if radius < SMALL:
        told.append(f"balls are only {radius:.1f} pixels in radius: centres are poor")
    if optics.blur[1] > SOFT * optics.blur[0] or max(optics.rough) > SOFT * max(learnt.noise, ROUGH[0]):
        told.append(
            "edges are rougher than the noise, as compression makes them: true errors may be twice the estimated"
        )
    if resting:
        told.append(
            f"{resting} ball{'s' * (resting > 1)} at rest most of the time: the cloth below is taken from around it"
        )
    if np.ptp(lights) > FLICKER:
        told.append(f"the light changes by {100 * np.ptp(lights):.0f} % between frames: allowed for")
    poor = [fit.sd for fit in found if fit.sd > POOR]
    if len(poor) > 0.05 * len(found):
        told.append(f"of {len(poor)} of {len(found)} outlines the centre is only known to {np.median(poor):.2f} pixels")
    return told


def _optics(found: Sequence[tuple[View, Fit]], optics: Optics) -> Optics:
    """What lens and sensor make of the clearest outlines: the blurs that leave least, and how edges scatter."""
    clean = sorted((f for f in found if np.isfinite(f[1].rest)), key=lambda f: -f[1].quality)[:CLEAN]

    def fitted(tried: Optics) -> list[tuple[View, Fit]]:
        each = [(view, [fit.xy for v, fit in clean if v is view]) for view in {id(v): v for v, _ in clean}.values()]
        return [(view, fit) for view, at in each for fit in fit_outlines(view, tried, at) if fit is not None]

    def middle(tried: Optics, of: Callable[[Fit], float]) -> float:
        fits = fitted(tried)
        return float(np.median([of(fit) for _, fit in fits])) if 2 * len(fits) > len(clean) else np.inf

    if not clean:
        return replace(optics, give=Optics.give)
    # Where colour is taken for too sharp, its edges seem to lie farther out. Along short normals every blur fits.
    pairs = []
    for light in BLURS:
        softer = [replace(optics, blur=(light, tint)) for tint in BLURS if tint >= light]
        pairs.append(min(softer, key=lambda tried: abs(middle(tried, lambda fit: fit.between))))
    best = min(pairs, key=lambda tried: middle(replace(tried, stretch=LONG), lambda fit: fit.rest))
    optics = replace(optics, blur=best.blur)
    for give in (optics.give, optics.give, Optics.give):
        clean = fitted(optics) or clean
        rough = np.maximum(np.median([fit.rough for _, fit in clean], axis=0), SMOOTHEST)
        size = float(np.median([fit.size for _, fit in clean]))
        optics = replace(optics, rough=(float(rough[0]), float(rough[1])), size=size, give=give)
    return optics
