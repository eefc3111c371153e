"""Where a model fails: significant departures of balls between events and at impacts, as sentences.

In: samples of segments and of whole shots, impacts. Out: `Findings`.

Between events every group of samples (a phase, and a range of speeds, places and so on) has four mean accelerations
that the model may lack: along the path, across it, along x, along y (sysid/residuals/accelerations.py). At impacts
every group has two mean velocities: along normal and tangent (sysid/residuals/impacts.py). Of hundreds of groups some
depart by chance, and one missing effect shows in many groups. So a group is named only if chance would find one like it
among all of them in one or two of a hundred comparisons (Bonferroni), and groups are named in turn: first the one that
explains the most, which is then subtracted from the residuals (matching pursuit, Mallat and Zhang 1993), until none is
significant. A variable's share is the chi-square beyond the noise that its groups explain together; its z is that of
the F test.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from models.shot import RAIL_NAMES, Table
from sysid.residuals.accelerations import Array, Index, Phases, phases_of
from sysid.residuals.bins import (
    ANGLE_EDGES_DEG,
    APPROACH_EDGES_M_S,
    SIDESPIN_EDGES_RAD_S,
    Variable,
    chosen,
    cut,
    order,
    place,
    variables,
)
from sysid.residuals.impacts import Impacts
from sysid.residuals.samples import Samples
from sysid.residuals.sentences import acceleration_sentence, spin_decay_sentence, velocity_sentence
from sysid.residuals.significance import TABLE_DIRECTION, CandidateDeparture, Candidates, Findings, pursue, sparse

Mask = NDArray[np.bool_]
PHASE_NAMES = {"slide": "sliding balls", "roll": "rolling balls"}
PHASE_OF_VARIABLE = {"slip": "slide"}  # variables of one phase
MIN_BLOCKS, MIN_IMPACTS = 8, 4  # fewest blocks, or impacts, of a group
MIN_TURNING_RAD_S = 5.0  # least sidespin whose decay is tested
STATE_ERROR = 0.003  # error of the state before an impact in addition to noise, over the approach [1]
MAX_JUMP_SCATTERS = 20.0  # robust standard deviations to which an impact's jump is clipped
IMPACT_KINDS = {  # of an impact's ball: its group in words
    "cushion": "rebounds from cushions", "hitting ball": "balls that hit another", "hit ball": "balls hit by another",
}  # fmt: skip


def find(
    segments: Samples, shots: Samples, impacts: Impacts, table: Table, clips: int, sigma: float, sd_theta: float
) -> Findings:
    """Find the significant departures.

    Args:
        segments: samples of segments, each with its fitted initial state.
        shots: samples of whole shots.
        impacts: velocities after impacts.
        table: of the clips.
        clips: how many there are.
        sigma: noise of positions per axis [m].
        sd_theta: noise of the marks' angles [rad].
    """
    parts = [p for p in (
        accelerations(segments, table, clips, sigma), spin_decays(shots, clips, sd_theta),
        velocities_after(impacts, table, clips),
    ) if p is not None]  # fmt: skip
    counts = [int(np.isfinite(p.single.value).sum()) for p in parts]
    named = [d for p, n in zip(parts, counts, strict=True) for d in pursue(p, min(n * len(parts), sum(counts)))]
    groups = [d for p in parts for d in p.departures()]
    dependence = [d for p in parts for d in p.dependence()]
    return Findings(
        tuple(sorted(named, key=lambda d: -d.gain)), tuple(groups),
        tuple(sorted(dependence, key=lambda d: (d.of, -d.share if np.isfinite(d.share) else 0.0))),
        sum(counts),
    )  # fmt: skip


def accelerations(samples: Samples, table: Table, clips: int, sigma: float) -> Candidates | None:
    """Missing accelerations of balls between events [m/s^2]; None without a sufficiently long phase."""
    known = np.array([m in PHASE_NAMES for m in samples.motion], dtype=bool)
    change = [a != b for a, b in zip(samples.motion[1:], samples.motion[:-1], strict=True)]
    number = np.cumsum(
        np.concatenate([[0], np.array(change, dtype=bool) | (np.diff(samples.segment) != 0)])[: len(known)]
    )
    phases = phases_of(np.where(known, number, -1), samples.clip, samples.time, -samples.residual, sigma)
    if phases is None:
        return None
    heading = np.stack([phases.mean(np.cos(samples.heading)), phases.mean(np.sin(samples.heading))])
    motion, known_variables = np.array(samples.motion), variables(samples, table, clips)
    found: list[CandidateDeparture] = []
    for phase in PHASE_NAMES:
        inside = motion == phase
        for variable in known_variables:
            if PHASE_OF_VARIABLE.get(variable.name, phase) == phase:
                found += _mean_accelerations(phases, heading, variable, phase, inside)
        found += _acceleration_slopes(phases, heading, samples, phase, inside)
    freedom = int(2 * len(phases.time) - 4 * len(phases.first))
    return Candidates("motion", tuple(found), phases.residual.T.ravel(), np.tile(phases.clip, 2), freedom)


def _mean_accelerations(
    phases: Phases, heading: Array, variable: Variable, phase: str, inside: Mask
) -> list[CandidateDeparture]:
    """Four mean accelerations of every group of a variable; heading (2, m) of the blocks, inside (n,) the phase."""
    found, (cos, sin) = [], heading
    whole = variable.name == "everywhere"
    for k, words in enumerate(variable.words):
        group = inside & (variable.group == k)
        share = phases.mean(group.astype(float))
        if (share > 0).sum() < MIN_BLOCKS:
            continue
        plain, c, s = phases.response(np.column_stack([share, share * cos, share * sin])).T
        none = np.zeros_like(plain)
        who = f"{PHASE_NAMES[phase]} {words}".rstrip()
        for quantity, x, y in (("along", c, s), ("across", -s, c), ("x", plain, none), ("y", none, plain)):
            name = (TABLE_DIRECTION if quantity in "xy" else "phase") if whole else variable.name
            found.append(CandidateDeparture(
                name, who, f"acceleration {quantity}", "m/s^2", int(np.sum(group)),
                acceleration_sentence(who, quantity), sparse(np.concatenate([x, y])),
            ))  # fmt: skip
    return found


def _acceleration_slopes(
    phases: Phases, heading: Array, samples: Samples, phase: str, inside: Mask
) -> list[CandidateDeparture]:
    """Candidate accelerations in proportion to speed, and to sidespin."""
    found, (cos, sin) = [], heading
    who, count = PHASE_NAMES[phase], int(inside.sum())
    for name, per, values, quantities in (
        ("speed", "m/s", samples.speed, ("along", "across")), ("sidespin", "rad/s", samples.spin, ("across",)),
    ):  # fmt: skip
        ramp = phases.mean(np.where(inside, values - values[inside].mean() if inside.any() else 0.0, 0.0))
        if (ramp != 0).sum() < MIN_BLOCKS:
            continue
        c, s = phases.response(np.column_stack([ramp * cos, ramp * sin])).T
        for quantity in quantities:
            x, y = (c, s) if quantity == "along" else (-s, c)
            found.append(CandidateDeparture(
                name, who, f"acceleration {quantity} per {name}", f"m/s^2 per {per}", count,
                acceleration_sentence(who, quantity, per), sparse(np.concatenate([x, y])),
            ))  # fmt: skip
    return found


def spin_decays(samples: Samples, clips: int, sd_theta: float) -> Candidates | None:
    """Missing decay of sidespin, from the marks [rad/s^2]; None without turning marks."""
    seen = np.isfinite(samples.angle)
    quick = seen & (np.abs(samples.spin) > MIN_TURNING_RAD_S)
    if not quick.any():
        return None
    rows = np.flatnonzero(seen)
    marked = _rows(samples, rows)
    label = np.where(quick, samples.segment, -1)[rows]
    phases = phases_of(label, marked.clip, marked.time, -marked.angle[:, None], sd_theta)
    if phases is None:
        return None
    sign, motion = np.sign(marked.spin), np.array(marked.motion)
    turning = {"slide": "sliding", "roll": "rolling", "spin": "spinning in place"}
    groups: list[tuple[str, str, Array]] = [("phase", "all turning balls", np.ones(len(marked.time)))]
    groups += [("phase", f"turning balls {words}", (motion == m).astype(float)) for m, words in turning.items()]
    size = cut("sidespin", np.abs(marked.spin), (MIN_TURNING_RAD_S, 20.0, 50.0, np.inf), "{} rad/s", "rad/s")
    speed = cut("speed", marked.speed, (0.0, 0.25, 0.5, 1.0, 2.0, np.inf), "{} m/s", "m/s")
    for v, words in ((size, "balls turning at"), (speed, "turning balls at")):
        groups += [(v.name, f"{words} {w}", (v.group == k).astype(float)) for k, w in enumerate(v.words)]
    for v in order(marked.clip, clips):
        groups += [(v.name, f"turning balls {w}", (v.group == k).astype(float)) for k, w in enumerate(v.words)]
    found = []
    for name, who, inside in groups:
        share = phases.mean(inside * sign)
        if (share != 0).sum() >= MIN_BLOCKS:
            found.append(CandidateDeparture(
                name, who, "acceleration of sidespin", "rad/s^2", int(inside.sum()), spin_decay_sentence(who),
                sparse(phases.response(share[:, None])[:, 0]),
            ))  # fmt: skip
    freedom = len(phases.time) - 2 * len(phases.first)
    return Candidates("turning", tuple(found), phases.residual[:, 0], phases.clip, freedom)


def velocities_after(impacts: Impacts, table: Table, clips: int) -> Candidates | None:
    """Missing velocities after impacts, over the approach [1]; None without impacts."""
    n = len(impacts.time)
    if n < MIN_IMPACTS:
        return None
    sd = np.hypot(impacts.sd, STATE_ERROR)[:, None] * np.ones((1, 2))
    cushion = np.array(impacts.kind) == "cushion"
    found: list[CandidateDeparture] = []
    for v in _impact_variables(impacts, cushion, table, clips):
        for k, who in enumerate(v.words):
            inside = (v.group == k).astype(float)
            if inside.sum() < MIN_IMPACTS:
                continue
            for i, quantity in enumerate(("normal", "tangent")):
                found.append(CandidateDeparture(
                    v.name, who, f"velocity along the {quantity} after", "of the approach", int(inside.sum()),
                    velocity_sentence(who, quantity), sparse(_of_axis(inside / sd[:, i], i)),
                ))  # fmt: skip
    for who, inside in (("rebounds from cushions", cushion), ("impacts of balls", ~cushion)):
        if inside.sum() < MIN_IMPACTS:
            continue
        for i, quantity in enumerate(("normal", "tangent")):
            weight = np.where(inside, sd[:, i] ** -2, 0.0)
            ramp = np.where(inside, impacts.approach - weight @ impacts.approach / weight.sum(), 0.0) / sd[:, i]
            found.append(CandidateDeparture(
                "speed of approach", who, f"velocity along the {quantity} after per m/s", "of the approach per m/s",
                int(inside.sum()), velocity_sentence(who, quantity, " for each m/s of approach"),
                sparse(_of_axis(ramp, i)),
            ))  # fmt: skip
    residual = (clipped_jumps(impacts) / sd).T.ravel()
    return Candidates("impacts", tuple(found), residual, np.tile(impacts.clip, 2).astype(np.int64), 2 * n)


def _of_axis(values: Array, axis: int) -> Array:
    """A column of the design matrix that concerns the normal (axis 0), or the tangent (1)."""
    none = np.zeros_like(values)
    return np.concatenate([values, none] if axis == 0 else [none, values])


def clipped_jumps(impacts: Impacts) -> Array:
    """Jumps of the impacts (n, 2), outliers of each kind clipped."""
    value, kind = impacts.jump.copy(), np.array(impacts.kind)
    sd = np.hypot(impacts.sd, STATE_ERROR)[:, None] * np.ones((1, 2))
    for name in IMPACT_KINDS:
        rows = np.flatnonzero(kind == name)
        if rows.size:
            middle = np.median(value[rows], axis=0)
            scatter = np.median(np.abs(value[rows] - middle) / sd[rows], axis=0) / 0.6745
            limit = MAX_JUMP_SCATTERS * np.maximum(scatter, 1.0) * sd[rows]
            value[rows] = np.clip(value[rows], middle - limit, middle + limit)
    return value


def _impact_variables(impacts: Impacts, cushion: Mask, table: Table, clips: int) -> list[Variable]:
    """Variables that velocities after impacts may depend on; cushion (n,) where a cushion was hit."""
    known = [
        chosen("event", tuple(IMPACT_KINDS.values()), np.array([list(IMPACT_KINDS).index(k) for k in impacts.kind])),
        chosen("rail", tuple(f"rebounds from rail {r}" for r in RAIL_NAMES),
               np.array([RAIL_NAMES.index(r) if r else -1 for r in impacts.rail])),
    ]  # fmt: skip
    finer = [
        cut("speed of approach", impacts.approach, APPROACH_EDGES_M_S, "at {} m/s", "m/s"),
        cut("angle of approach", np.degrees(impacts.angle), ANGLE_EDGES_DEG, "at {} degrees from the normal",
            "degrees"),
        cut("sidespin", impacts.spin, SIDESPIN_EDGES_RAD_S, "with sidespin {} rad/s", "rad/s"),
        place(impacts.xy, table),
        *order(impacts.clip, clips),
    ]  # fmt: skip
    for v in finer:
        for who, inside in (("rebounds from cushions", cushion), ("impacts of balls", ~cushion)):
            words = tuple(f"{who} {w}" for w in v.words)
            known.append(Variable(v.name, words, np.where(inside, v.group, -1), v.middle, v.unit))
    for r in RAIL_NAMES:
        on = np.array([rail == r for rail in impacts.rail], dtype=bool)
        fast = impacts.approach > 1.0
        words = (f"rebounds from rail {r} below 1 m/s", f"rebounds from rail {r} above 1 m/s")
        known.append(chosen("rail and speed", words, np.where(on, fast.astype(int), -1)))
    return known


def _rows(samples: Samples, rows: Index) -> Samples:
    """Some of the samples."""
    picked: dict[str, Any] = {
        key: tuple(value[r] for r in rows) if isinstance(value, tuple) else value[rows]
        for key, value in vars(samples).items()
    }
    return Samples(**picked)
