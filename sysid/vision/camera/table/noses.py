"""Which edges beside the bed are the noses: readings of the cushions, weighed by everything that is seen.

In: the edges along each side, and what else the picture shows. Out: `CushionReading`, the likeliest choice of an edge
per side, with the camera that goes with it, and how much likelier it is than one that places balls elsewhere.

Beside the noses a picture shows the shadows that the cushions cast on the bed, and the end of the cloth on top of the
cushions, a cushion's width outside the noses and the same at all sides. A reading is a least squares problem in the
camera's pose, focal length and distortion, the width of the cushions, and the place of the diamonds; its sum of squares
is linear in the offsets of the edges chosen, near a rough camera:

    r = r0 + A o + J p,    cost = |(1 - J J^+) (r0 + A o)|^2 + the costs of edges that do not look like noses.

All readings are ranked by this; the camera is then improved, and they are ranked again.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.optimize import least_squares

from models.shot import NOSE_HEIGHT
from sysid.vision.camera.pose import Rails, distances, jacobian, moved
from sysid.vision.camera.printed.marker_camera import FOCAL_SD, K1_SD, marker_residuals
from sysid.vision.camera.printed.markers import Markers
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.camera.table.ball_outlines import BallOutlines
from sysid.vision.camera.table.diamonds import Diamonds
from sysid.vision.camera.table.edges import Edge, nose_crossings, nose_points

CLOTH_EDGE_M = 0.008  # edges nearer than this to the outline of the cloth are that outline
MAX_GAP_WIDTH_M = 0.025  # of the dark gap under a nose
EDGES_KEPT = 5  # of a side, those that look most like noses
LINE_PLACES = 7  # at which an edge counts
CLOTH_END_SEARCH_M = 0.02  # about the outline of the cloth
NOSE_SD_M = 1.5e-3  # of a straight nose
CLOTH_END_SD_M = 3e-3  # of the end of the cloth behind it
DIAMOND_SD_M = 2e-3  # of a diamond along its rail
ROW_SD_M = 4e-3  # and of its row's distance from the nose
EDGE_SD_PX = 0.7  # added to all of them
HELD_SD_PX = 5.0  # of a corner that a person gave, and holds
CUSHION_WIDTH_M = (0.045, 0.012)  # mean and standard deviation
DIAMOND_MARGIN_M = (0.095, 0.03)
RAIL_RISE_M = (0.008, 0.006)  # of the rail's top over the noses
UNSEEN_COST = 9.0  # of a side without a nose
WEAKNESS_COST = (
    1.0  # of an edge weaker than the strongest of its side by a factor of e; goes with the logarithm's square
)
UNSEEN_END_COST = 4.0  # and of one where the cloth does not seem to end
UNLIKE_COST = 4.0  # of an edge that looks like the inner edge of a shadow
OUTLINE_COST = 1.5  # of the end of the cloth where there are edges farther in
RANKING_ROUNDS = 3
MIN_NOSES = 3  # of a reading
MAX_MARKER_SD = 3.0  # that a marker counts for
MAX_BALL_SD = 3.0  # that the elongation of a ball does
DIFFERENT_M = 6e-3  # between the edges of two readings that are not the same
FAR_COST = 1e4  # of edges with which a camera is not over the table


@dataclass(frozen=True)
class TableEvidence:
    """What is seen of the table."""

    edges: Mapping[int, Sequence[Edge]]  # by rail, offsets from the expected nose of the rough camera
    ends: Mapping[int, Edge]  # of the cloth on the cushions, likewise, where they are seen
    cloth_pixels: Array  # (n, 2) of the end of the cloth on the cushions, LINE_PLACES for each side that shows it
    cloth_rails: Rails  # (n,)
    diamonds: Diamonds
    balls: BallOutlines
    markers: Markers
    corners: Array = field(default_factory=lambda: np.zeros((0, 2)))  # (4, 2) crossings of nose lines that are held


@dataclass(frozen=True)
class CushionReading:
    """A choice of edges as noses."""

    noses: Mapping[int, Edge]  # by rail, offsets from the noses of the rough camera
    camera: Camera
    cost: float  # sum of squares of what is seen, in standard deviations
    lead: float  # of the cost of the next one that differs over this one's
    cushion_width: float  # from the noses to the end of the cloth [m]
    diamond_margin: float  # from the noses to the diamonds [m]
    focal_sd: float  # of its focal length, relative; NaN where that is known
    at_end: bool  # whether the noses are the end of the cloth
    total: float  # the cost with those of looks and of ends of the cloth that are not seen
    rival: Camera | None  # that goes with the next reading that differs


def what_is_seen(
    rough: Camera, edges: Mapping[int, Sequence[Edge]], outline: float, diamonds: Diamonds, balls: BallOutlines,
    markers: Markers, search: float = CLOTH_END_SEARCH_M,
) -> TableEvidence:  # fmt: skip
    """What is seen of the table.

    Args:
        rough: camera.
        edges: by rail, offsets from its noses.
        outline: of the cloth, distance out of the noses [m].
        diamonds: seen.
        balls: seen.
        markers: seen, those that agree.
        search: about the outline, in which the cloth may end [m].
    """
    near = {rail: [e for e in some if abs(e.offset - outline) < search] for rail, some in edges.items()}
    ends = {rail: max(some, key=lambda e: e.strength) for rail, some in near.items() if some}
    pixels = [_line(rough, rail, [end.offset])[end.offset] for rail, end in ends.items()]
    rails = np.repeat(np.array(list(ends), np.intp), LINE_PLACES)
    return TableEvidence(edges, ends, np.concatenate([np.zeros((0, 2)), *pixels]), rails, diamonds, balls, markers)


class _ReadingProblem:
    """The least squares problem of all readings, about a camera."""

    def __init__(self, rough: Camera, seen: TableEvidence, free: tuple[str, ...], focal: float) -> None:
        self.rough, self.seen, self.free, self.focal = rough, seen, free, focal

    def residuals(self, camera: Camera, extra: Array, pixels: Array, rails: Rails) -> Array:
        """Of noses at pixels (n, 2) on rails (n,), and of all the rest; extra: cushion width, diamond margin, rise."""
        size = camera.eye[2] / camera.matrix[0, 0]
        width, margin, rise = extra
        nose = distances(camera, pixels, rails) / np.hypot(NOSE_SD_M, EDGE_SD_PX * size) / np.sqrt(LINE_PLACES / 2)
        ends = distances(camera, self.seen.cloth_pixels, self.seen.cloth_rails, width)
        ends = 3 * np.tanh(ends / np.hypot(CLOTH_END_SD_M, EDGE_SD_PX * size) / 3) / np.sqrt(LINE_PLACES / 2)
        parts = [nose, ends, self._diamonds(camera, margin, rise, size)]
        ratio, ratio_sd = self.seen.balls.ratio(camera)
        parts.append(np.array([np.log(ratio) / ratio_sd if np.isfinite(ratio) else 0.0]))
        longer = self.seen.balls.elongation_errors(camera)  # what was taken for a ball need not be one
        parts.append(MAX_BALL_SD * np.tanh(longer / MAX_BALL_SD))
        markers = marker_residuals(camera, self.seen.markers)  # one of them may lie wrongly all the same
        parts.append(MAX_MARKER_SD * np.tanh(markers / MAX_MARKER_SD))
        parts.append(corner_errors(camera, self.seen.corners).ravel() / HELD_SD_PX)
        known = [(width, CUSHION_WIDTH_M), (margin, DIAMOND_MARGIN_M), (rise, RAIL_RISE_M)]
        known += [(float(np.log(camera.matrix[0, 0] / self.focal)), (0.0, FOCAL_SD))] * ("focal" in self.free)
        known += [(float(camera.distortion[0]), (0.0, K1_SD))] * ("k1" in self.free)
        parts.append(np.array([(value - mean) / sd for value, (mean, sd) in known]))
        return np.concatenate(parts)

    def _diamonds(self, camera: Camera, margin: float, rise: float, size: float) -> Array:
        """Residuals of the diamonds along their rails and across them."""
        along, across = diamond_errors(camera, self.seen.diamonds, margin, rise)
        sd = [np.hypot(sd, EDGE_SD_PX * size) for sd in (DIAMOND_SD_M, ROW_SD_M)]
        return np.concatenate([along / sd[0], across / sd[1]])

    def ends(self, count: int) -> slice:
        """Where the residuals of the end of the cloth lie behind those of so many points on noses."""
        return slice(count, count + len(self.seen.cloth_pixels))

    def at(self, change: Array, pixels: Array, rails: Rails) -> Array:
        """Residuals of a change of the rough camera and of the extra unknowns."""
        count = 6 + len(self.free)
        return self.residuals(moved(self.rough, change[:count], self.free), change[count:], pixels, rails)


def corner_errors(camera: Camera, given: Array) -> Array:
    """How far the nearest crossings of nose lines lie from corners (n, 2): (n, 2) [pixels]."""
    off = np.nan_to_num(nose_crossings(camera), nan=1e4)[None] - given[:, None]
    nearest = np.linalg.norm(off, axis=2).argmin(axis=1)
    return np.asarray(off[np.arange(len(given)), nearest])


def diamond_errors(camera: Camera, diamonds: Diamonds, margin: float, rise: float) -> tuple[Array, Array]:
    """How far diamonds lie from their places along their rails and across them: (n,), (n,) [m].

    Args:
        camera: the camera.
        diamonds: seen.
        margin: of the rows outside the noses [m].
        rise: of the rails' tops over the noses [m].
    """
    xy = np.nan_to_num(camera.on_plane(diamonds.pixels, NOSE_HEIGHT * camera.radius + rise), nan=9.0)
    k, axis = np.arange(len(xy)), diamonds.rails // 2
    half = np.array([camera.table.length, camera.table.width]) / 2
    out = (1.0 - 2.0 * (diamonds.rails % 2)) * xy[k, axis] - half[axis] - margin
    return xy[k, 1 - axis] - diamonds.along, out


def read_noses(
    rough: Camera, seen: TableEvidence, outline: float, free: tuple[str, ...], focal: float
) -> CushionReading | None:
    """The likeliest reading of the cushions; None where fewer than three sides, or two beside markers, show an edge.

    Args:
        rough: camera.
        seen: what is seen.
        outline: of the cloth, distance out of the noses of the rough camera [m].
        free: unknown intrinsic parameters: "k1", "focal".
        focal: expected focal length, if it is unknown [pixels].
    """
    options = {rail: _rated(some, outline, len(seen.edges)) for rail, some in seen.edges.items()}
    fewest = MIN_NOSES - 1 if len(seen.markers) else MIN_NOSES
    readings = [c for c in itertools.product(*options.values()) if _conceivable(c, outline, fewest)]
    if not readings:
        return None
    rails, camera, cost, focal_sd = list(options), rough, 0.0, np.nan
    extra = np.array([CUSHION_WIDTH_M[0], DIAMOND_MARGIN_M[0], RAIL_RISE_M[0]])
    looks = np.array([sum(cost for _, cost in reading) for reading in readings])
    places = {rail: _line(rough, rail, [e.offset for e, _ in some if e]) for rail, some in options.items()}
    best, costs = 0, looks
    for _ in range(RANKING_ROUNDS):
        problem = _ReadingProblem(camera, seen, free, focal)
        costs = looks + _linear_costs(problem, readings, rails, places, extra, outline)
        ranked = np.argsort(costs, kind="stable")[:3]
        tried = [_fitted(problem, rails, readings[k], places, extra, outline) for k in ranked]
        k = int(np.argmin([fit[2] + looks[row] for fit, row in zip(tried, ranked, strict=True)]))
        before, best = best, int(ranked[k])
        camera, extra, cost, focal_sd = tried[k]
        if best == before:
            break
    others = [k for k, other in enumerate(readings) if _differ(other, readings[best])]
    rival, lead = None, np.inf
    if others:
        second = min(others, key=lambda k: costs[k])
        lead = float(costs[second] - costs[best])
        rival = _fitted(problem, rails, readings[second], places, extra, outline)[0]
    noses = {rail: edge for rail, (edge, _) in zip(rails, readings[best], strict=True) if edge is not None}
    at_end = _at_end(readings[best], outline)
    total = cost + float(looks[best]) + (0.0 if at_end else UNSEEN_END_COST * (len(seen.edges) - len(seen.ends)))
    width, margin = extra[:2].tolist()
    return CushionReading(noses, camera, cost, lead, width, margin, focal_sd, at_end, total, rival)


def with_rival(best: CushionReading | None, other: CushionReading | None) -> CushionReading | None:
    """A reading, whose lead is no more than that over a less likely one from another view, if that differs."""
    if best is None or other is None:
        return best
    corners = best.camera.table.corners()
    there = other.camera.on_plane(best.camera.outline(corners), best.camera.radius)
    if np.linalg.norm(there - corners, axis=1).max() < DIFFERENT_M:
        return best
    return dataclasses.replace(best, lead=min(best.lead, other.total - best.total))


def _differ(one: Sequence[tuple[Edge | None, float]], other: Sequence[tuple[Edge | None, float]]) -> bool:
    """Whether two readings take different edges at a side that both of them see."""
    return any(a and b and abs(a.offset - b.offset) > DIFFERENT_M for (a, _), (b, _) in zip(one, other, strict=True))


def _at_end(reading: Sequence[tuple[Edge | None, float]], outline: float) -> bool:
    """Whether the noses of a reading are the end of the cloth, which then gives no width of the cushions."""
    return all(edge is None or edge.offset > outline - CLOTH_EDGE_M for edge, _ in reading)


def _conceivable(reading: Sequence[tuple[Edge | None, float]], outline: float, fewest: int) -> bool:
    """Whether the sides go together.

    So many must show a nose, or all where the noses are the end of the cloth, which is seen; and it is so at all
    sides or at none.
    """
    edges = [edge for edge, _ in reading if edge is not None]
    at_end = sum(edge.offset > outline - CLOTH_EDGE_M for edge in edges)
    return len(edges) >= fewest and at_end in ((0, len(edges)) if len(edges) == len(reading) else (0,))


def _rated(edges: Sequence[Edge], outline: float, sides: int) -> list[tuple[Edge | None, float]]:
    """The edges of a side that look most like noses, with the cost of their looks; None for a nose that is hidden."""
    inner = [e for e in edges if e.offset < outline - CLOTH_EDGE_M]
    strongest = max((e.strength for e in inner), default=0.0)
    rated: list[tuple[Edge | None, float]] = []
    for edge in edges:
        if edge.offset > outline + CLOTH_END_SEARCH_M:
            continue
        is_outline = edge.offset > outline - CLOTH_EDGE_M
        below_gap = not edge.rises and any(e.rises and 0 < e.offset - edge.offset < MAX_GAP_WIDTH_M for e in inner)
        weakness = 0.0 if is_outline else WEAKNESS_COST * float(np.log(edge.strength / strongest)) ** 2
        rated.append((edge, weakness + UNLIKE_COST * below_gap + OUTLINE_COST * (is_outline and strongest > 0)))
    rated = sorted(rated, key=lambda pair: pair[1])[:EDGES_KEPT]
    return [*rated, (None, UNSEEN_COST if sides == 4 else 4 * UNSEEN_COST)]


def _line(camera: Camera, rail: int, offsets: Sequence[float]) -> dict[float, Array]:
    """Pixels (LINE_PLACES, 2) along edges of a rail at offsets of the rough camera [m]."""
    half = 0.8 * (camera.table.length, camera.table.width)[1 - rail // 2] / 2
    along = np.linspace(-half, half, LINE_PLACES)
    return {o: camera.project(nose_points(camera, rail, along, np.full(LINE_PLACES, o))) for o in offsets}


def _linear_costs(
    problem: _ReadingProblem, readings: Sequence[tuple[tuple[Edge | None, float], ...]], rails: list[int],
    places: Mapping[int, Mapping[float, Array]], extra: Array, outline: float,
) -> Array:  # fmt: skip
    """Costs of all readings (n,), about the camera of the problem."""
    used = [rail for rail in rails if places[rail]]
    middle = {rail: next(iter(places[rail].values())) for rail in used}
    pixels, names = np.concatenate(list(middle.values())), np.repeat(np.array(used, np.intp), LINE_PLACES)
    zero = np.concatenate([np.zeros(6 + len(problem.free)), extra])
    slopes = jacobian(lambda change: problem.at(change, pixels, names), zero)
    base = problem.at(zero, pixels, names)
    own = {rail: {o: problem.at(zero, np.concatenate([p if r == rail else middle[r] for r in used]), names)
                  for o, p in places[rail].items()} for rail in used}  # fmt: skip
    projections: dict[tuple[bool, ...], Array] = {}
    costs = np.empty(len(readings))
    for n, reading in enumerate(readings):
        at_end = _at_end(reading, outline)
        there = *(edge is not None for (edge, _), rail in zip(reading, rails, strict=True) if rail in used), at_end
        rows = np.concatenate([np.repeat(np.array(there[:-1]), LINE_PLACES), np.ones(len(base) - len(pixels), bool)])
        rows[problem.ends(len(pixels))] = not at_end
        if there not in projections:
            projections[there] = np.linalg.qr(slopes[rows])[0]
        r = base.copy()
        for rail, (edge, _) in zip(rails, reading, strict=True):
            if edge is not None:
                place = slice(used.index(rail) * LINE_PLACES, (used.index(rail) + 1) * LINE_PLACES)
                r[place] = own[rail][edge.offset][place]
        r, q = r[rows], projections[there]
        costs[n] = float(r @ r - np.sum((q.T @ r) ** 2))
    return costs


def _fitted(
    problem: _ReadingProblem, rails: Sequence[int], reading: Sequence[tuple[Edge | None, float]],
    places: Mapping[int, Mapping[float, Array]], extra: Array, outline: float,
) -> tuple[Camera, Array, float, float]:  # fmt: skip
    """The camera of one reading, the extra unknowns, the cost, and the relative sd of a free focal length."""
    chosen = {rail: edge for rail, (edge, _) in zip(rails, reading, strict=True) if edge is not None}
    pixels = np.concatenate([places[rail][edge.offset] for rail, edge in chosen.items()])
    names, at_end = np.repeat(np.array(list(chosen), np.intp), LINE_PLACES), _at_end(reading, outline)
    start = np.concatenate([np.zeros(6 + len(problem.free)), extra])

    def residuals(change: Array) -> Array:
        out = problem.at(change, pixels, names)
        return np.delete(out, problem.ends(len(pixels))) if at_end else out

    fit = least_squares(residuals, start, lambda c: jacobian(residuals, c), x_scale=0.01, max_nfev=40)
    camera = moved(problem.rough, fit.x[: 6 + len(problem.free)], problem.free)
    if camera.eye[2] <= 0:
        return problem.rough, extra, FAR_COST, np.nan
    focal_sd = np.nan
    if "focal" in problem.free:
        focal_sd = float(np.sqrt(np.linalg.pinv(fit.jac.T @ fit.jac).diagonal()[6 + problem.free.index("focal")]))
    return camera, fit.x[6 + len(problem.free) :], 2 * float(fit.cost), focal_sd


def with_offsets(edges: Mapping[int, Edge], rough: Camera, camera: Camera) -> dict[int, Edge]:
    """Edges by rail, seen from a rough camera, with their offsets from the noses of another."""
    found = {}
    for rail, edge in edges.items():
        pixels = _line(rough, rail, [edge.offset])[edge.offset]
        offset = float(np.mean(distances(camera, pixels, np.full(LINE_PLACES, rail))))
        found[rail] = dataclasses.replace(edge, offset=offset)
    return found
