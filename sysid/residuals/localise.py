"""Where a model fails: departures of balls between events and at impacts, by evidence, in plain words.

Between events every group of samples (a phase, and what the ball was doing there) has four mean accelerations that the
model lacks: along the way, across it, along x, along y (sysid/residuals/accelerations.py). At impacts every group has
two mean velocities that it lacks: along normal and tangent (sysid/residuals/impacts.py). Of hundreds of groups some
depart by chance, and where one thing is missing many groups show it. So a group is named only if chance would give one
like it among all of them once or twice in a hundred comparisons (Bonferroni), and groups are named one after another:
first the one that explains the most of what is left, which is then taken out of the rest (matching pursuit, Mallat and
Zhang 1993), until no group is sure.
A variable's share is how much chi-square beyond the noise its groups explain together; its z that of the F test.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from models.shot import RAIL_NAMES, Table
from sysid.residuals.accelerations import Array, Index, runs_of
from sysid.residuals.bins import ANGLES, APPROACHES, SIDESPINS, Variable, chosen, cut, order, place, variables
from sysid.residuals.impacts import Impacts
from sysid.residuals.samples import Samples
from sysid.residuals.significance import TABLE, Candidates, Findings, Head, pursue, signature

PHASES = {"slide": "sliding balls", "roll": "rolling balls"}
ONLY = {"slip": "slide"}  # variables of one phase
PER = {"m/s": "m/s of speed", "rad/s": "rad/s of sidespin to the right"}
LEAST_BLOCKS, LEAST_IMPACTS = 8, 4
LEAST_SPIN = 5.0  # sidespin whose decay is looked at [rad/s]
FLOOR = 0.003  # of the approach: what the state before an impact is not known better than [1]
WILD = 20.0  # scatters beyond which an impact's jump is drawn in
Say = Callable[[float, float], str]


def find(stretches: Samples, shots: Samples, impacts: Impacts, table: Table, clips: int, sigma: float,
         sd_theta: float) -> Findings:  # fmt: skip
    """Name what departs; `sigma` [m] and `sd_theta` [rad] are the noise per axis and of the marks."""
    parts = [p for p in (
        pulls(stretches, table, clips, sigma), turns(shots, clips, sd_theta), jumps(impacts, table, clips)
    ) if p is not None]  # fmt: skip
    counts = [int(np.isfinite(p.own.value).sum()) for p in parts]
    named = [d for p, n in zip(parts, counts, strict=True) for d in pursue(p, min(n * len(parts), sum(counts)))]
    groups = [d for p in parts for d in p.departures()]
    dependence = [d for p in parts for d in p.dependence()]
    return Findings(
        tuple(sorted(named, key=lambda d: -d.gain)), tuple(groups),
        tuple(sorted(dependence, key=lambda d: (d.of, -d.share if np.isfinite(d.share) else 0.0))),
        sum(counts),
    )  # fmt: skip


def pulls(samples: Samples, table: Table, clips: int, sigma: float) -> Candidates | None:
    """Accelerations of balls between events that the model lacks [m/s^2]; None without a run."""
    known = np.array([m in PHASES for m in samples.motion], dtype=bool)
    change = [a != b for a, b in zip(samples.motion[1:], samples.motion[:-1], strict=True)]
    part = np.cumsum(
        np.concatenate([[0], np.array(change, dtype=bool) | (np.diff(samples.stretch) != 0)])[: len(known)]
    )
    runs = runs_of(np.where(known, part, -1), samples.clip, samples.time, -samples.miss, sigma)
    if runs is None:
        return None
    cos, sin = runs.mean(np.cos(samples.heading)), runs.mean(np.sin(samples.heading))
    motion, what = np.array(samples.motion), variables(samples, table, clips)
    found, heads = [], []
    for phase in PHASES:
        inside = motion == phase
        for variable in what:
            if ONLY.get(variable.name, phase) != phase:
                continue
            for k, words in enumerate(variable.words):
                share = runs.mean((inside & (variable.group == k)).astype(float))
                count = int(np.sum(inside & (variable.group == k)))
                if (share > 0).sum() < LEAST_BLOCKS:
                    continue
                plain, c, s = runs.bent(np.column_stack([share, share * cos, share * sin])).T
                none = np.zeros_like(plain)
                who = f"{PHASES[phase]} {words}".rstrip()
                whole = variable.name == "everywhere"
                for quantity, one, other in (
                    ("along", c, s),
                    ("across", -s, c),
                    ("x", plain, none),
                    ("y", none, plain),
                ):
                    name = (TABLE if quantity in "xy" else "phase") if whole else variable.name
                    found.append(signature(np.concatenate([one, other])))
                    heads.append(Head(name, who, f"acceleration {quantity}", "m/s^2", count, _pulled(who, quantity)))
        for name, per, values, sides in (
            ("speed", "m/s", samples.speed, ("along", "across")), ("sidespin", "rad/s", samples.spin, ("across",)),
        ):  # fmt: skip
            ramp = runs.mean(np.where(inside, values - values[inside].mean() if inside.any() else 0.0, 0.0))
            count = int(inside.sum())
            if (ramp != 0).sum() < LEAST_BLOCKS:
                continue
            c, s = runs.bent(np.column_stack([ramp * cos, ramp * sin])).T
            for quantity in sides:
                one, other = (c, s) if quantity == "along" else (-s, c)
                found.append(signature(np.concatenate([one, other])))
                say = _pulled(PHASES[phase], quantity, per)
                unit = f"m/s^2 per {per}"
                heads.append(Head(name, PHASES[phase], f"acceleration {quantity} per {name}", unit, count, say))
    free = int(2 * len(runs.time) - 4 * len(runs.first))
    residual = runs.residual.T.ravel()
    return Candidates("motion", tuple(found), residual, np.tile(runs.clip, 2), free, tuple(heads))


def turns(samples: Samples, clips: int, sd_theta: float) -> Candidates | None:
    """Decay of sidespin that the model lacks, from the marks [rad/s^2]; None without marks that turn."""
    seen = np.isfinite(samples.angle)
    quick = seen & (np.abs(samples.spin) > LEAST_SPIN)
    if not quick.any():
        return None
    label = np.where(quick, samples.stretch, -1)
    order_ = np.flatnonzero(seen)
    few = _rows(samples, order_)
    runs = runs_of(label[order_], few.clip, few.time, -few.angle[:, None], sd_theta)
    if runs is None:
        return None
    sign, motion = np.sign(few.spin), np.array(few.motion)
    turning = {"slide": "sliding", "roll": "rolling", "spin": "spinning in place"}
    groups: list[tuple[str, str, Array]] = [("phase", "all turning balls", np.ones(len(few.time)))]
    groups += [("phase", f"turning balls {words}", (motion == m).astype(float)) for m, words in turning.items()]
    size = cut("sidespin", np.abs(few.spin), (LEAST_SPIN, 20.0, 50.0, np.inf), "{} rad/s", "rad/s")
    speed = cut("speed", few.speed, (0.0, 0.25, 0.5, 1.0, 2.0, np.inf), "{} m/s", "m/s")
    for v, words in ((size, "balls turning at"), (speed, "turning balls at")):
        groups += [(v.name, f"{words} {w}", (v.group == k).astype(float)) for k, w in enumerate(v.words)]
    for v in order(few.clip, clips):
        groups += [(v.name, f"turning balls {w}", (v.group == k).astype(float)) for k, w in enumerate(v.words)]
    found, heads = [], []
    for name, who, inside in groups:
        share = runs.mean(inside * sign)
        if (share != 0).sum() >= LEAST_BLOCKS:
            found.append(signature(runs.bent(share[:, None])[:, 0]))
            heads.append(Head(name, who, "acceleration of sidespin", "rad/s^2", int(inside.sum()), _turned(who)))
    free = len(runs.time) - 2 * len(runs.first)
    residual = runs.residual[:, 0]
    return Candidates("turning", tuple(found), residual, runs.clip, free, tuple(heads))


def jumps(impacts: Impacts, table: Table, clips: int) -> Candidates | None:
    """Velocities after impacts that the model lacks, over the approach [1]; None without impacts."""
    n = len(impacts.time)
    if n < LEAST_IMPACTS:
        return None
    value, sd = impacts.jump.copy(), np.hypot(impacts.sd, FLOOR)[:, None] * np.ones((1, 2))
    kind = np.array(impacts.kind)
    for name in ("cushion", "hitting ball", "hit ball"):
        rows = np.flatnonzero(kind == name)
        if rows.size:
            middle = np.median(value[rows], axis=0)
            scatter = np.median(np.abs(value[rows] - middle) / sd[rows], axis=0) / 0.6745
            reach = WILD * np.maximum(scatter, 1.0) * sd[rows]
            value[rows] = np.clip(value[rows], middle - reach, middle + reach)
    known = [
        chosen("event", ("rebounds from cushions", "balls that hit another", "balls hit by another"),
               np.array([("cushion", "hitting ball", "hit ball").index(k) for k in impacts.kind])),
        chosen("rail", tuple(f"rebounds from rail {r}" for r in RAIL_NAMES),
               np.array([RAIL_NAMES.index(r) if r else -1 for r in impacts.rail])),
    ]  # fmt: skip
    cushion = kind == "cushion"
    finer = [
        cut("speed of approach", impacts.approach, APPROACHES, "at {} m/s", "m/s"),
        cut("angle of approach", np.degrees(impacts.angle), ANGLES, "at {} degrees from the normal", "degrees"),
        cut("sidespin", impacts.spin, SIDESPINS, "with sidespin {} rad/s", "rad/s"),
        place(impacts.xy, table),
        *order(impacts.clip, clips),
    ]
    for v in finer:
        for who, inside in (("rebounds from cushions", cushion), ("impacts of balls", ~cushion)):
            words = tuple(f"{who} {w}" for w in v.words)
            known.append(Variable(v.name, words, np.where(inside, v.group, -1), v.middle, v.unit))
    for r in RAIL_NAMES:
        on = np.array([rail == r for rail in impacts.rail], dtype=bool)
        fast = impacts.approach > 1.0
        words = (f"rebounds from rail {r} below 1 m/s", f"rebounds from rail {r} above 1 m/s")
        known.append(chosen("rail and speed", words, np.where(on, fast.astype(int), -1)))
    found, heads = [], []
    none = np.zeros(n)
    for v in known:
        for k, who in enumerate(v.words):
            inside = (v.group == k).astype(float)
            if inside.sum() < LEAST_IMPACTS:
                continue
            for i, quantity in enumerate(("normal", "tangent")):
                part = inside / sd[:, i]
                found.append(signature(np.concatenate([part, none] if i == 0 else [none, part])))
                heads.append(Head(
                    v.name, who, f"velocity along the {quantity} after", "of the approach", int(inside.sum()),
                    _left(who, quantity),
                ))  # fmt: skip
    for who, inside in (("rebounds from cushions", cushion), ("impacts of balls", ~cushion)):
        if inside.sum() < LEAST_IMPACTS:
            continue
        for i, quantity in enumerate(("normal", "tangent")):
            weight = np.where(inside, sd[:, i] ** -2, 0.0)
            ramp = np.where(inside, impacts.approach - weight @ impacts.approach / weight.sum(), 0.0) / sd[:, i]
            found.append(signature(np.concatenate([ramp, none] if i == 0 else [none, ramp])))
            heads.append(Head(
                "speed of approach", who, f"velocity along the {quantity} after per m/s", "of the approach per m/s",
                int(inside.sum()), _left(who, quantity, " for each m/s of approach"),
            ))  # fmt: skip
    residual = (value / sd).T.ravel()
    return Candidates("impacts", tuple(found), residual, np.tile(impacts.clip, 2).astype(np.int64), 2 * n, tuple(heads))


def _pulled(who: str, quantity: str, per: str = "") -> Say:
    """The sentence of an acceleration that is missing, or that is missing for each unit of something."""

    def say(value: float, sd: float) -> str:
        size = f"{_pair(1e3 * abs(value), 1e3 * sd)} mm/s^2" + (f" for each {PER[per]}" if per else "")
        if quantity == "along":
            what = f"slow down by {size} {'less' if value > 0 else 'more'} than modelled"
        elif quantity == "across":
            what = f"are pulled by {size} to the {'left' if value > 0 else 'right'} of their way"
        else:
            what = f"are pulled by {size} towards {'+' if value > 0 else '-'}{quantity}"
        return f"{who}: {what} (z {abs(value) / sd:.0f})"

    return say


def _turned(who: str) -> Say:
    return lambda value, sd: (
        f"{who}: lose {_pair(abs(value), sd)} rad/s of sidespin a second {'less' if value > 0 else 'more'} "
        f"than modelled (z {abs(value) / sd:.0f})"
    )


def _left(who: str, quantity: str, per: str = "") -> Say:
    """The sentence of a velocity that is missing after an impact."""

    def say(value: float, sd: float) -> str:
        size = f"{_pair(100 * abs(value), 100 * sd)} % of the approach" + per
        if quantity == "normal" and who.startswith("rebounds"):
            what = f"leave {'faster' if value > 0 else 'slower'} by {size}"
        elif quantity == "normal":
            what = f"go on {'faster' if value > 0 else 'slower'} along the line of centres by {size}"
        else:
            what = f"keep {size} {'more' if value > 0 else 'less'} of the speed along the tangent"
        return f"{who}: {what} than modelled (z {abs(value) / sd:.0f})"

    return say


def _pair(value: float, sd: float) -> str:
    """Value and sd, to two digits of the sd."""
    digits = int(np.clip(1 - np.floor(np.log10(sd)), 0, 6)) if sd > 0 and np.isfinite(sd) else 3
    return f"{value:.{digits}f} +- {sd:.{digits}f}"


def _rows(samples: Samples, rows: Index) -> Samples:
    picked: dict[str, Any] = {
        key: tuple(value[r] for r in rows) if isinstance(value, tuple) else value[rows]
        for key, value in vars(samples).items()
    }
    return Samples(**picked)
