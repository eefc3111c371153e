"""What a review draws on the table: balls, models, contacts with their impulses, spin, and magnified misses.

Every model has entity paths of its own, `top/model/LABEL` and `space/model/LABEL`, so that it can be shown or hidden as
a whole. The last of the ladder is the one whose contacts, impulses and spin are drawn. An impulse is the ball's mass
times the change of its velocity from the last sample before the contact to the first one after it: friction on the
cloth within that time is included, and contacts of a ball within one such time share an arrow. A spin arrow lies along
the axis of rotation by the right hand, as long as the ball's surface goes in SPIN_S.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.recording.clips import LaidClip, ReviewOut, appearances, finite
from models.recording.table import PATH_HEIGHT_M, lift
from models.shot import Array, Ball, Track
from models.table.palette import MODEL_COLOUR, WHITE_COLOUR, Colour

EVENT_MARKS = {
    "cushion": ("cushion", (255, 160, 0)),
    "ball": ("ball hits ball", (255, 70, 220)),
    "pocket": ("pot", WHITE_COLOUR),
}
BASE_COLOUR: Colour = (255, 159, 28)  # as in the page (models/report/scripts/report.js); no red ball's
STEP_COLOURS: tuple[Colour, ...] = ((190, 150, 255), (190, 255, 90), (255, 205, 120), (120, 170, 255))
MAX_LABELLED = 6  # most events of a clip with words on the table
IMPULSE_M_PER_N_S = 1.0  # length of an impulse's arrow
MIN_IMPULSE_N_S = 0.002  # a smaller one is not drawn
SPIN_S = 0.06  # a spin arrow is as long as the surface goes in this time [s]
SPIN_PERIOD_S = 1 / 30  # least time between two spin arrows [s]
MIN_SPIN_M = 0.002  # a shorter spin arrow is not drawn
MAX_MISSES = 80  # magnified misses of a ball in a clip
MAGNIFICATIONS, MAX_DRAWN_M = (100, 50, 20, 10, 5, 2, 1), 0.12  # of misses, and the length to which large ones go


def model_colours(labels: Sequence[str]) -> dict[str, Colour]:
    """A colour for every model of the ladder: the last as in all pictures, the base its own."""
    steps = {label: STEP_COLOURS[k % len(STEP_COLOURS)] for k, label in enumerate(labels[1:-1])}
    return {**dict.fromkeys(labels[:1], BASE_COLOUR), **steps, **dict.fromkeys(labels[-1:], MODEL_COLOUR)}


def draw_measured(out: ReviewOut, ball: Ball) -> None:
    """Balls as they were seen, and over each clip their whole paths as dots."""
    rr, r = out.rr, ball.radius
    for name in out.names(""):
        rows, xy = appearances(out.clips, "", name)
        whole = [
            finite(*clip.places[""][name])[1] if name in clip.places[""] else np.empty((0, 2)) for clip in out.clips
        ]
        dots, flat, high = out.per_clip([len(path) for path in whole]), np.concatenate(whole), lift(xy, r)
        shared = {"colors": out.colour(name), "labels": f"{name}, measured", "show_labels": False}
        for path, kind, style, points, when in (
            ("top/measured", rr.Points2D, {"radii": r, "draw_order": 20}, xy, rows),
            ("top/measured_path", rr.Points2D, {"radii": -1.8, "draw_order": 0}, flat, dots),
            ("space/measured", rr.Points3D, {"radii": r}, high, rows),
            ("space/measured_path", rr.Points3D, {"radii": -1.5}, lift(flat, PATH_HEIGHT_M), dots),
        ):
            out.moving(f"{path}/{out.path(name)}", kind, {**shared, **style}, {"positions": points}, when)


def draw_models(out: ReviewOut, ball: Ball) -> None:
    """Every model's balls as rings and globes, and over each clip their whole paths as lines."""
    rr, r = out.rr, ball.radius
    colours = model_colours(out.labels())
    glass = {"fill_mode": "transparentfillmajorwireframe", "line_radii": -0.7}
    for label, name in [(each, name) for each in colours for name in out.names(each)]:
        rows, xy = appearances(out.clips, label, name)
        known = [clip.places.get(label, {}).get(name) for clip in out.clips]
        whole = [np.empty((0, 2)) if one is None else finite(*one)[1] for one in known]
        strips, lines = [path for path in whole if len(path) > 1], out.per_clip([int(len(p) > 1) for p in whole])
        high, order = lift(xy, r), 12 if label == out.labels()[-1] else 10
        ring = {"centers": xy, "half_sizes": np.full(xy.shape, r)}
        globe = {"centers": high, "half_sizes": np.full(high.shape, 1.04 * r)}
        raised = {"strips": [lift(strip, PATH_HEIGHT_M) for strip in strips]}
        shared = {"colors": colours[label], "labels": f"{name}, {label}", "show_labels": False}
        things: tuple[tuple[str, str, Any, Mapping[str, Any], Mapping[str, Any], Any], ...] = (
            ("top", "ball", rr.Ellipses2D, {"line_radii": -1.5, "draw_order": 20 + order}, ring, rows),
            ("top", "path", rr.LineStrips2D, {"radii": -1.0, "draw_order": order}, {"strips": strips}, lines),
            ("space", "ball", rr.Ellipsoids3D, glass, globe, rows),
            ("space", "path", rr.LineStrips3D, {"radii": -1.0}, raised, lines),
        )
        for view, part, kind, style, data, when in things:
            out.moving(f"{view}/model/{out.path(label, part, name)}", kind, {**shared, **style}, data, when)


def draw_events(out: ReviewOut, ball: Ball, label: str) -> None:
    """A model's contacts: a mark and an impulse on the table for the whole clip, and a mark in the plot of errors."""
    rr = out.rr
    events = [clip.events(label) for clip in out.clips]
    for kind, (word, colour) in EVENT_MARKS.items():
        found = [
            (c, e, xy.mean(axis=0), f"{word} {e.time:.2f} s" if len(every) <= MAX_LABELLED else "")
            for c, every in zip(out.clips, events, strict=True)
            for e, xy in every
            if e.kind == kind and len(xy)
        ]
        if not found:
            continue
        count = [sum(clip is c for c, *_ in found) for clip in out.clips]
        style = {"colors": colour, "radii": 0.35 * ball.radius, "draw_order": 40}
        data = {"positions": np.array([xy for _, _, xy, _ in found]), "labels": [text for *_, text in found]}
        out.moving(f"top/event/{kind}", rr.Points2D, style, data, out.per_clip(count))
        rows = [c.index for c, *_ in found], [c.start + e.time for c, e, *_ in found], [1] * len(found)
        style = {"colors": colour, "markers": "diamond", "marker_sizes": 5.0, "names": word}
        out.fixed(f"error/distance/event_{kind}", rr.SeriesPoints(**style))
        out.moving(f"error/distance/event_{kind}", rr.Scalars, {}, {"scalars": np.zeros(len(found))}, rows)
        _draw_impulses(out, ball, label, kind)


def impulses(clip: LaidClip, label: str, kind: str, mass: float) -> list[tuple[Array, Array]]:
    """Where a model's balls were at contacts of a kind (2,) [m], and their impulses (2,) [N s]; mass [kg]."""
    track = clip.review.models.get(label)
    if track is None:
        return []
    found: dict[tuple[int, int], tuple[Array, Array]] = {}
    for event in (event for event, _ in clip.events(label) if event.kind == kind):
        for name in event.balls:
            after, ball = int(np.searchsorted(track.times, event.time, side="right")), track.names.index(name)
            if not 0 < after < len(track.times):
                continue
            change = mass * (track.velocity[after, ball] - track.velocity[after - 1, ball])
            if np.isfinite(change).all() and math.hypot(*change) > MIN_IMPULSE_N_S:
                place = np.array([np.interp(event.time, track.times, axis) for axis in track.position[:, ball].T])
                found.setdefault((after, ball), (place, change))
    return list(found.values())


def _draw_impulses(out: ReviewOut, ball: Ball, label: str, kind: str) -> None:
    """Arrows at contacts of a kind, for the whole clip."""
    each = [impulses(clip, label, kind, ball.mass) for clip in out.clips]
    found = [one for some in each for one in some]
    if not found:
        return
    rr, count = out.rr, out.per_clip([len(some) for some in each])
    origins, sizes = np.array([place for place, _ in found]), np.array([change for _, change in found])
    words = [f"impulse {size:.3f} N s" for size in np.hypot(*sizes.T)]
    vectors, colour = IMPULSE_M_PER_N_S * sizes, EVENT_MARKS[kind][1]
    data = {"origins": origins, "vectors": vectors, "labels": words}
    style = {"colors": colour, "radii": -1.5, "draw_order": 35, "show_labels": False}
    out.moving(f"top/impulse/{kind}", rr.Arrows2D, style, data, count)
    data = {"origins": lift(origins, ball.radius), "vectors": lift(vectors, 0.0), "labels": words}
    out.moving(
        f"space/impulse/{kind}", rr.Arrows3D, {"colors": colour, "radii": 0.004, "show_labels": False}, data, count
    )


def draw_spin(out: ReviewOut, ball: Ball, label: str) -> None:
    """Spin of a model's balls as arrows along the axis, in the 3-D view."""
    for name in out.names(label):
        clips = [clip for clip in out.clips if name in clip.places.get(label, {})]
        parts = [_spin_arrows(clip.review.models[label], name, ball.radius) for clip in clips]
        index = np.concatenate([np.full(len(one[0]), clip.index) for clip, one in zip(clips, parts, strict=True)])
        times = np.concatenate([clip.start + one[0] for clip, one in zip(clips, parts, strict=True)])
        shown = np.concatenate([seen for _, seen, _, _ in parts])
        origins = np.concatenate([origin[seen] for _, seen, origin, _ in parts])
        vectors = np.concatenate([arrow[seen] for _, seen, _, arrow in parts])
        if len(origins):
            style, data = {"colors": out.curve_colour(name), "radii": 0.003}, {"origins": origins, "vectors": vectors}
            rows = index, times, shown.astype(int)
            out.moving(f"space/spin/{out.path(name)}", out.rr.Arrows3D, style, data, rows)


def _spin_arrows(track: Track, name: str, radius: float) -> tuple[Array, NDArray[np.bool_], Array, Array]:
    """Times (n,) [s], whether there is an arrow then (n,), origins and arrows (n, 3) [m] of one ball's spin."""
    ball, step = track.names.index(name), float(np.diff(track.times).mean()) if len(track.times) > 1 else SPIN_PERIOD_S
    kept = np.unique(
        np.append(np.arange(0, len(track.times), max(1, round(SPIN_PERIOD_S / step))), -1 % len(track.times))
    )
    arrows = SPIN_S * radius * track.spin[kept, ball]
    origins = lift(track.position[kept, ball], radius)
    seen = np.isfinite(np.hstack([arrows, origins])).all(axis=1) & (np.linalg.norm(arrows, axis=1) > MIN_SPIN_M)
    seen[-1] = False
    new = seen | np.append(True, seen[:-1])  # a sample without an arrow hides the last one
    return track.times[kept][new], seen[new], origins[new], arrows[new]


def magnification(clips: Sequence[LaidClip]) -> int:
    """How many times larger misses are drawn: large ones of any model stay within MAX_DRAWN_M."""
    sizes = np.concatenate([np.zeros(1), *(clip.distances(label) for clip in clips for label in clip.errors)])
    large = 1e-3 * float(np.quantile(sizes, 0.98))
    return next((m for m in MAGNIFICATIONS if m * large <= MAX_DRAWN_M), 1)


def draw_misses(out: ReviewOut, times_larger: int) -> None:
    """Every model's misses, magnified: lines from where a ball was seen towards where the model has it."""
    for label, colour in model_colours(out.labels()).items():
        for name in out.names(label):
            each = [_misses(clip, label, name, times_larger) for clip in out.clips]
            strips = [line for some in each for line in some]
            if strips:
                style = {"colors": colour, "radii": -0.8, "draw_order": 11 if colour == MODEL_COLOUR else 10}
                rows = out.per_clip([len(some) for some in each])
                path = f"top/miss/{out.path(label, name)}"
                out.moving(path, out.rr.LineStrips2D, style, {"strips": strips}, rows)


def _misses(clip: LaidClip, label: str, name: str, times_larger: int) -> Array:
    """Lines from measured places, at most MAX_MISSES: (n, 2, 2) [m]."""
    error = clip.errors.get(label, {}).get(name)
    if error is None:
        return np.empty((0, 2, 2))
    places = clip.places[""][name][1]
    ends = places + 1e-3 * times_larger * error[1][:, 1:]
    known = np.flatnonzero(np.isfinite(ends).all(axis=1))
    kept = known[:: max(1, math.ceil(len(known) / MAX_MISSES))]
    return np.stack([places[kept], ends[kept]], axis=1)
