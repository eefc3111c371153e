"""Model against measurement: each clip's own unknowns fitted, constants as they are, and where it fails."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from models.model_file import Model
from models.shot import Track
from sysid.clips import ClipSet
from sysid.comparison import ClipRow, Comparison, Departure, Samples, SegmentRow
from sysid.fit import MISCUT, SEGMENT_ROBUST, cloth_constants, segment_ratios, values_of
from sysid.noise import position_noise
from sysid.own import events_and_ways, fit_own, polish
from sysid.problem import STEPS, Array, ShotProblem, residual, segment_problem, shot_problem, theta_noise
from sysid.segments import split_all
from sysid.solve import fit_each

SLIPS = 0.01  # slip speed above which a ball slides [m/s]
STILL = 0.003  # speed below which it rests [m/s]
SPINS = 1.0  # sidespin above which a resting ball spins [rad/s]
LEAST = 12  # samples of a group worth naming
PARTS = ("clip", "struck", "time", "xy", "miss", "speed", "heading", "spin", "angle")
SIDESPINS = (0.0, 5.0, 20.0, 50.0, np.inf)  # [rad/s]
SPEEDS = (0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, np.inf)
Report = Callable[[str], None]


def compare(
    clip_set: ClipSet, model: Model, report: Report = lambda line: None, start: Array | None = None
) -> Comparison:
    """Compare whole clips and segments with a model; `start` (n, 7) are own unknowns that are nearly right already."""
    sigma = position_noise(clip_set)
    segments = compare_segments(clip_set, model, sigma)
    report(f"{len(segments)} segments between events")
    problem = shot_problem(model, (), clip_set, sigma)
    none = np.zeros(0)
    x = fit_own(problem, clip_set, none, sigma, report) if start is None else start
    x = polish(problem, x, none)
    n = len(clip_set.clips)
    tracks = problem.tracks(x, np.zeros((n, 0)), np.arange(n))
    used = set(model.fitted.get("clips", ())) if model.fitted else set()
    held = {c.file for c in clip_set.clips} - used if used else set()
    rows = tuple(_clip_row(problem, clip_set, k, tracks[k], sigma, clip_set.clips[k].file in held) for k in range(n))
    samples = collect(problem, tracks, clip_set)
    where = departures(samples, segments, rows, clip_set, sigma)
    return Comparison(clip_set, model, sigma, rows, segments, where, samples, tuple(tracks), clip_set.clips, x)


def compare_segments(clip_set: ClipSet, model: Model, sigma: float) -> tuple[SegmentRow, ...]:
    """Every segment between events, its own unknowns fitted."""
    segments = split_all(clip_set.clips, clip_set.table, clip_set.ball, sigma, clip_set.fps)
    if not segments:
        return ()
    names = cloth_constants(model)
    problem = segment_problem(model, names, segments, sigma)
    c = values_of(model, names)
    x, _ = fit_each(problem.evaluate, problem.start, c, STEPS, problem.prior, SEGMENT_ROBUST, 10)
    ratio = segment_ratios(problem, x, c)
    return tuple(
        SegmentRow(
            clip_set.clips[s.clip].file, s.ball, s.before, float(s.time[0]), float(s.time[-1]),
            float(np.hypot(x[k, 2], x[k, 3])), float(ratio[k]),
        )
        for k, s in enumerate(segments)
    )  # fmt: skip


def _clip_row(problem: ShotProblem, clip_set: ClipSet, k: int, track: Track, sigma: float, held: bool) -> ClipRow:
    clip = clip_set.clips[k]
    square, count, moved, moved_count, chi, freedom = 0.0, 0, 0.0, 0, 0.0, -7
    for b, name in enumerate(track.names):
        seen = clip.balls[name]
        miss, _ = residual(track, b, seen, len(seen.time))
        distance = np.sum(miss**2, axis=1)
        if b == 0:
            square, count = float(distance.sum()), len(distance)
        if b == 0 or np.ptp(seen.xy, axis=0).max() > 0.003:
            moved, moved_count = moved + float(distance.sum()), moved_count + len(distance)
        trusted = problem.trusted[k][name]
        chi += float(distance[trusted].sum()) / sigma**2
        freedom += 2 * int(trusted.sum())
    return ClipRow(
        clip.file, float(np.sqrt(square / count)), float(np.sqrt(moved / moved_count)), chi / max(freedom, 1), held
    )


def collect(problem: ShotProblem, tracks: Sequence[Track], clip_set: ClipSet) -> Samples:
    """Every trusted sample of moving balls with what the model says of that moment."""
    parts: dict[str, list[Array]] = {k: [] for k in PARTS}
    ball: list[str] = []
    motion: list[str] = []
    last: list[str] = []
    events: list[Array] = []
    radius = clip_set.ball.radius
    for k, track in enumerate(tracks):
        clip = clip_set.clips[k]
        for b, name in enumerate(track.names):
            seen = clip.balls[name]
            miss, angle = residual(track, b, seen, len(seen.time))
            index = np.searchsorted(track.times, seen.time)
            v, w = track.velocity[index, b], track.spin[index, b]
            own = [e for e in track.events if name in e.balls]
            count = np.searchsorted([e.time for e in own], seen.time)
            keep = problem.trusted[k][name] & np.isfinite(v[:, 0])
            if b:
                keep &= count > 0
            speed = np.hypot(v[:, 0], v[:, 1])
            slip = np.hypot(v[:, 0] - radius * w[:, 1], v[:, 1] + radius * w[:, 0])
            kinds = np.where(
                slip > SLIPS,
                "slide",
                np.where(speed > STILL, "roll", np.where(np.abs(w[:, 2]) > SPINS, "spin", "rest")),
            )
            met = np.array(["strike", *[e.kind for e in own]])[count]
            n = int(keep.sum())
            for key, value in (
                ("clip", np.full(n, k)), ("struck", np.full(n, b == 0)), ("time", seen.time[keep]),
                ("xy", seen.xy[keep]), ("miss", miss[keep]), ("speed", speed[keep]),
                ("heading", np.arctan2(v[keep, 1], v[keep, 0])), ("spin", w[keep, 2]), ("angle", angle[keep]),
            ):  # fmt: skip
                parts[key].append(value)
            ball += [name] * n
            motion += list(kinds[keep])
            last += list(met[keep])
            events.append(count[keep])
    data = {key: np.concatenate(value) for key, value in parts.items()}
    return Samples(
        data["clip"].astype(np.int64), tuple(ball), data["struck"].astype(bool), data["time"], data["xy"], data["miss"],
        data["speed"], data["heading"], data["spin"], tuple(str(m) for m in motion), tuple(str(m) for m in last),
        np.concatenate(events).astype(np.int64), data["angle"],
    )  # fmt: skip


def departures(
    samples: Samples, segments: Sequence[SegmentRow], rows: Sequence[ClipRow], clip_set: ClipSet, sigma: float
) -> tuple[Departure, ...]:
    """Groups of samples by what the ball did, met and was, the worst of each kind first."""
    square = np.sum(samples.miss**2, axis=1)
    found: list[Departure] = []

    def group(by: str, labels: Sequence[str] | Array, words: Callable[[str], str]) -> None:
        labels = np.asarray(labels)
        rows = []
        for label in sorted(set(labels.tolist())):
            pick = labels == label
            if pick.sum() >= LEAST:
                mean = float(square[pick].mean())
                ratio = float(np.sqrt(mean / 2) / sigma)
                rows.append(Departure(by, words(str(label)), float(np.sqrt(mean)), ratio, int(pick.sum())))
        found.extend(sorted(rows, key=lambda d: -d.ratio))

    phase = {"slide": "while sliding", "roll": "while rolling", "spin": "spinning in place", "rest": "at rest"}
    group("phase", samples.motion, lambda m: phase[m])
    later = samples.events > 1
    met = [f"{last} again" if more else last for last, more in zip(samples.last, later, strict=True)]
    meant = {
        "strike": "before the first event", "ball": "after one ball-ball impact", "cushion": "after one cushion impact",
        "ball again": "after several, the last with a ball", "cushion again": "after several, the last with a cushion",
    }  # fmt: skip
    group("event", met, lambda m: meant.get(m, m))
    band = np.digitize(samples.speed, SPEEDS) - 1
    group("speed", [str(b) for b in band], lambda b: f"at {_range(SPEEDS, int(b))} m/s")
    spin = np.digitize(np.abs(samples.spin), SIDESPINS) - 1
    group("sidespin", [str(b) for b in spin], lambda b: f"at {_range(SIDESPINS, int(b))} rad/s")
    group("ball", np.where(samples.struck, "struck", "object"), lambda s: f"the {s} ball")
    found.extend(_marks(samples, clip_set.ball.radius, theta_noise(clip_set.clips)))
    segment_groups: dict[str, list[float]] = {}
    for s in segments:
        if s.ratio < MISCUT:
            segment_groups.setdefault(f"segments from {s.before}", []).append(s.ratio)
    for words, ratios in sorted(segment_groups.items(), key=lambda item: -float(np.median(item[1]))):
        middle = float(np.median(ratios))
        found.append(Departure("segment", words, middle * sigma * np.sqrt(2), middle, len(ratios)))
    counts = {c.file: sum(len(o.time) for o in c.balls.values()) for c in clip_set.clips}
    for row in sorted(rows, key=lambda r: -r.rms_m)[:5]:
        found.append(Departure("clip", row.file, row.rms_m, row.rms_m / np.sqrt(2) / sigma, counts[row.file]))
    return tuple(found)


def coverage(comparison: Comparison, rate: float) -> float:
    """Share of held-out residuals inside the 95 % band of noise and the model's error rate; NaN without any."""
    clip_set, sigma = comparison.clip_set, comparison.noise_m
    _, way = events_and_ways(clip_set, sigma)
    inside = total = 0
    for k, row in enumerate(comparison.clips):
        if not row.held_out:
            continue
        track = comparison.tracks[k]
        for b, name in enumerate(track.names):
            seen = clip_set.clips[k].balls[name]
            miss, _ = residual(track, b, seen, len(seen.time))
            band = 1.96 * np.hypot(sigma, rate * way[k][name])[:, None]
            moving = way[k][name] > 0
            inside += int(np.sum(np.abs(miss[moving]) < band[moving]))
            total += 2 * int(moving.sum())
    return inside / total if total else float("nan")


def _range(edges: Sequence[float], k: int) -> str:
    return f"{edges[k]:g} to {edges[k + 1]:g}" if np.isfinite(edges[k + 1]) else f"over {edges[k]:g}"


def _marks(samples: Samples, radius: float, sd_theta: float) -> list[Departure]:
    """How far the marks' angles are missed, as way on the ball's surface, by sidespin."""
    found = []
    seen = np.isfinite(samples.angle)
    band = np.digitize(np.abs(samples.spin), SIDESPINS) - 1
    for k in sorted(set(band[seen].tolist())):
        pick = seen & (band == k)
        if pick.sum() >= LEAST:
            rms = float(np.sqrt(np.mean(samples.angle[pick] ** 2)))
            words = f"the mark's angle at {_range(SIDESPINS, k)} rad/s"
            found.append(Departure("mark", words, rms * radius, rms / sd_theta, int(pick.sum())))
    return sorted(found, key=lambda d: -d.ratio)


def in_words(comparison: Comparison) -> list[str]:
    """The largest departures as sentences."""
    noise = comparison.noise_m
    lines = []
    for by, about in (
        ("phase", "motion"),
        ("event", "events"),
        ("speed", "speed"),
        ("mark", "turning"),
        ("segment", "segments"),
    ):
        groups = [d for d in comparison.where if d.by == by]
        if len(groups) >= 1:
            worst, best = max(groups, key=lambda d: d.ratio), min(groups, key=lambda d: d.ratio)
            line = f"By {about}: worst {worst.where}, {worst.rms_m * 1e3:.1f} mm ({worst.ratio:.1f} times the noise)"
            if worst is not best:
                line += f"; best {best.where}, {best.rms_m * 1e3:.1f} mm ({best.ratio:.1f})"
            lines.append(line + ".")
    worst_clip = next((d for d in comparison.where if d.by == "clip"), None)
    if worst_clip:
        lines.append(f"Worst clip: {worst_clip.where}, {worst_clip.rms_m * 1e3:.1f} mm.")
    if all(d.ratio < 1.3 for d in comparison.where):
        lines = [f"Nothing stands out: every group lies within 1.3 times the noise of {noise * 1e3:.2f} mm."]
    return lines
