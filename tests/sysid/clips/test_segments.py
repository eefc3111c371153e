"""Tracks are cut where something happened, by what an independent simulation says happened when."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from models.shot import Ball, Table
from sysid.clips import Clip, Observation, read_clip_set
from sysid.clips.segments import CLAMP_MARGIN_M, Segment, cuts_of, event_times, onset, split, split_all
from tests.truth.__main__ import jittered
from tests.truth.cloth import Constants
from tests.truth.physics import Motion, Start, simulate
from tests.truth.physics import Table as TrueTable
from tests.truth.shots import play

FPS, SIGMA = 120.0, 5e-4
SNOOKER, CAROM = (Table(3.569, 1.778), Ball(0.0525, 0.1406)), (Table(2.84, 1.42, pockets=False), Ball(0.0615, 0.21))
SLOW = 0.2  # rebounds from slower approaches drown in the noise [m/s]
KINDS = ("cushion", "cushion_side", "cut", "cut_side", "long")


@dataclass(frozen=True)
class Filmed:
    """A clip and what really happened in it."""

    clip: Clip
    motion: Motion
    table: Table
    ball: Ball

    def events(self, name: str) -> list[float]:
        """When a ball really touched something, so hard that a camera can tell, while it was on the table [s]."""
        b, found = self.motion.names.index(name), []
        for e in self.motion.events:
            before = max(int(np.searchsorted(self.motion.times, e.time)) - 1, 0)
            speed = abs(self.motion.velocity[before, b, "xy".index(e.rail[1])]) if e.kind == "cushion" else np.inf
            if name in e.balls and e.kind != "pocket" and speed > SLOW and e.time < self.last(name):
                found.append(e.time)
        return found

    def last(self, name: str) -> float:
        """When a ball was last seen [s]."""
        return float(self.clip.balls[name].time[-1])

    def segments(self) -> list[Segment]:
        return split(0, self.clip, self.table, self.ball, SIGMA, FPS)

    def cut_times(self, name: str) -> np.ndarray:
        tracks = {n: onset(o, SIGMA, FPS) for n, o in self.clip.balls.items()}
        cuts = cuts_of(name, tracks, self.table, self.ball, SIGMA)
        return tracks[name].time[[c.sample for c in cuts]] if cuts else np.zeros(0)


def film(motion: Motion, rng: np.random.Generator, on: tuple[Table, Ball], missing: float = 0.0) -> Filmed:
    """What a camera sees of a motion: noise on every position, some samples missing, a potted ball gone."""
    balls = {}
    for b, name in enumerate(motion.names):
        xy = motion.xy[:, b] + SIGMA * rng.normal(size=motion.xy[:, b].shape)
        seen = np.isfinite(xy[:, 0]) & (rng.random(len(xy)) >= missing)
        seen[0] = True
        balls[name] = Observation(motion.times[seen], xy[seen], np.full(int(seen.sum()), np.nan))
    return Filmed(Clip("clips/1.csv", "cue", balls), motion, *on)


def shots(on: tuple[Table, Ball], count: int, missing: float, seed: int) -> list[Filmed]:
    """Random shots with cushions and cuts on that table."""
    table, ball = on
    true_table = TrueTable(table.length, table.width, table.pockets)
    c = jittered(seed, Constants(radius=ball.radius, mass=ball.mass))
    made = []
    for k in range(count):
        rng = np.random.default_rng([seed, k])
        motion = play(KINDS[k % len(KINDS)], rng, true_table, c, 3.0, FPS).motion
        made.append(film(motion, rng, on, missing))
    return made


@pytest.fixture(scope="module")
def snooker() -> list[Filmed]:
    return shots(SNOOKER, 30, 0.01, 21)


@pytest.fixture(scope="module")
def carom() -> list[Filmed]:
    """Another table, and every seventh sample lost."""
    return shots(CAROM, 30, 0.15, 22)


@pytest.fixture(params=["snooker", "carom"])
def many(request: pytest.FixtureRequest) -> list[Filmed]:
    found: list[Filmed] = request.getfixturevalue(request.param)
    return found


def alone(start: Start, seconds: float = 2.0, **others: Start) -> Motion:
    """A chosen shot on the snooker table."""
    times = np.arange(round(seconds * FPS)) / FPS
    return simulate(TrueTable(), Constants(), {"cue": start, **others}, times)


def seen(motion: Motion, missing: float = 0.0) -> Filmed:
    return film(motion, np.random.default_rng(1), SNOOKER, missing)


@pytest.mark.slow
def test_every_event_lies_beside_a_cut(many: list[Filmed]) -> None:
    total = 0
    for shot in many:
        for name in shot.clip.balls:
            time = shot.clip.balls[name].time
            for event in shot.events(name):
                k = int(np.searchsorted(time, event))
                # As near as two samples, of which some may be missing.
                span = time[min(k + 1, len(time) - 1)] - time[max(k - 2, 0)]
                gap = np.abs(shot.cut_times(name) - event).min(initial=np.inf)
                assert gap < max(2 / FPS, span), f"{name}: event at {event:.3f} s, cuts at {shot.cut_times(name)}"
                total += 1
    assert total > 40


def test_no_segment_holds_an_event(many: list[Filmed]) -> None:
    total = 0
    for shot in many:
        for s in shot.segments():
            inside = [e for e in shot.events(s.ball) if s.time[0] < e < s.time[-1]]
            assert inside == [], f"{s.ball} from {s.time[0]:.3f} to {s.time[-1]:.3f} s"
            total += len(s.time) >= 5
    assert total > 80


def test_most_of_a_free_run_is_kept(many: list[Filmed]) -> None:
    """Cuts cost a few samples each, not the run."""
    kept = due = 0
    for shot in many:
        b = shot.clip.struck
        kept += sum(len(s.time) for s in shot.segments() if s.ball == b)
        due += len(shot.clip.balls[b].time)
    assert kept > 0.85 * due


def test_a_cushion_shot_is_named() -> None:
    shot = seen(alone(Start((1.0, 0.1), (1.6, 0.3), (0.0, 60.0, 0.0)), 1.5))
    [event] = shot.motion.events
    first, second = shot.segments()
    assert (first.before, first.after, first.rail) == ("strike", "cushion", "")
    assert (second.before, second.after, second.rail) == ("cushion", "end", "+x")
    assert first.time[-1] < event.time < second.time[0]
    assert event_times(shot.clip, *SNOOKER, SIGMA, FPS) == pytest.approx([event.time], abs=1.5 / FPS)


def test_several_cushions_in_order() -> None:
    shot = seen(alone(Start((0.3, 0.2), (2.4, 2.0), (-70.0, 80.0, 0.0)), 2.0))
    truth = [e for e in shot.motion.events if e.kind == "cushion"]
    assert len(truth) >= 2
    parts = shot.segments()
    assert [p.rail for p in parts] == ["", *[e.rail for e in truth]]
    assert event_times(shot.clip, *SNOOKER, SIGMA, FPS) == pytest.approx([e.time for e in truth], abs=1.5 / FPS)


def test_a_cut_shot_parts_both_balls() -> None:
    shot = seen(alone(Start((-0.3, 0.0), (1.5, 0.0), (0.0, 0.0, 0.0)), 0.9, red=Start((0.1, 0.03))))
    [event] = shot.motion.events
    parts = shot.segments()
    assert [(p.ball, p.before, p.after) for p in parts] == [
        ("cue", "strike", "ball"), ("cue", "ball", "end"), ("red", "ball", "end"),
    ]  # fmt: skip
    before, *after = parts
    assert before.time[-1] < event.time
    for part in after:
        assert event.time < part.time[0] < event.time + 3.5 / FPS


def test_a_ball_spun_in_place_is_one_segment() -> None:
    shot = seen(alone(Start((0.2, 0.1), (0.02, 0.0), (0.0, 0.0, 50.0)), 1.5))
    assert all(p.ball == "cue" and (p.before, p.after) == ("strike", "end") for p in shot.segments())


def test_resting_balls_give_no_segments() -> None:
    others = {"red": Start((0.9, 0.6)), "black": Start((-1, 0.5))}
    shot = seen(alone(Start((-0.3, 0.0), (0.8, 0.0), (0.0, 0.0, 0.0)), 1.0, **others))
    assert {p.ball for p in shot.segments()} == {"cue"}
    still = Observation(np.arange(50) / FPS, np.zeros((50, 2)), np.full(50, np.nan))
    assert split(0, Clip("clips/1.csv", "cue", {"cue": still}), *SNOOKER, SIGMA, FPS) == []


def test_a_near_miss_harms_nobody() -> None:
    """A ball that passes another within a hair keeps its motion; at most a sample goes."""
    shot = seen(alone(Start((-0.4, 0.0), (1.2, 0.0), (0.0, 45.0, 0.0)), 0.8, red=Start((0.0, 0.0535))))
    assert shot.motion.events == ()
    parts = [p for p in shot.segments() if p.ball == "cue"]
    assert sum(len(p.time) for p in parts) >= len(shot.clip.balls["cue"].time) - 4


def test_clamped_samples_are_dropped() -> None:
    """A tracker that holds a ball a radius from the nose line has seen nothing there."""
    table, ball = SNOOKER
    shot = seen(alone(Start((1.6, 0.1), (0.5, 0.05), (0.0, 19.0, 0.0)), 0.8))
    cue = shot.clip.balls["cue"]
    edge = np.array([table.length, table.width]) / 2 - ball.radius
    clamped = Observation(cue.time, np.clip(cue.xy, -edge, edge), cue.theta)
    assert np.any(np.abs(clamped.xy) == edge)
    for track in (cue, clamped):
        for part in replace(shot, clip=replace(shot.clip, balls={"cue": track})).segments():
            assert np.all(np.abs(part.xy) < edge - CLAMP_MARGIN_M)


def test_a_potted_ball_ends_its_last_segment() -> None:
    shot = seen(alone(Start((1.2, 0.32), (1.5, 1.5), (0.0, 0.0, 0.0)), 1.5))
    assert [e.kind for e in shot.motion.events] == ["pocket"]
    part = shot.segments()[-1]
    assert part.time[-1] <= shot.motion.events[0].time


def test_a_strike_seen_late_costs_what_precedes_it() -> None:
    """A clip that begins before the stroke, whose first moving frame blurs the blow."""
    rest, shot = 15, seen(alone(Start((-0.5, 0.0), (1.2, 0.2), (0.0, 0.0, 0.0)), 0.8))
    cue = shot.clip.balls["cue"]
    waiting = np.repeat(cue.xy[:1], rest, axis=0) + SIGMA * np.random.default_rng(2).normal(size=(rest, 2))
    late = Observation(
        np.concatenate([np.arange(rest) / FPS, cue.time + rest / FPS]), np.concatenate([waiting, cue.xy]),
        np.full(rest + len(cue.time), np.nan),
    )  # fmt: skip
    [part] = split(0, Clip("clips/1.csv", "cue", {"cue": late}), *SNOOKER, SIGMA, FPS)
    assert (rest - 1) / FPS <= part.time[0] < (rest + 4) / FPS
    assert len(part.time) >= len(cue.time) - 4


def test_short_segments_are_left_out(snooker: list[Filmed]) -> None:
    clips = [s.clip for s in snooker]
    everything = [s for k, c in enumerate(clips) for s in split(k, c, *SNOOKER, SIGMA, FPS)]
    found = split_all(clips, *SNOOKER, SIGMA, FPS, least=9)
    assert [(s.clip, s.ball, s.time[0]) for s in found] == [
        (s.clip, s.ball, s.time[0]) for s in everything if len(s.time) >= 9
    ]
    assert all(len(s.time) == len(s.xy) and np.all(np.diff(s.time) > 0) for s in found)


def test_measured_carom_shots_are_cut(data_folder: Path) -> None:
    """Two real shots from a league table, clamped and smeared: cuts, and no segment that leaps."""
    clip_set = read_clip_set(data_folder / "carom-match")
    found = split_all(clip_set.clips[:10], clip_set.table, clip_set.ball, 1e-3, clip_set.fps)
    assert len(found) > 20
    for s in found:
        speed = np.hypot(*np.diff(s.xy, axis=0).T) / np.diff(s.time)
        assert speed.max() < 15.0


def without_short_moves(seen: Observation, least: float) -> Observation:
    """What a tracker writes that leaves out balls until they have moved so far [m] from where it last saw them."""
    kept = [0]
    for k in range(1, len(seen.time)):
        if np.hypot(*(seen.xy[k] - seen.xy[kept[-1]])) > least:
            kept.append(k)
    return Observation(seen.time[kept], seen.xy[kept], seen.theta[kept])


def test_balls_meet_where_a_tracker_left_out_the_resting_one(carom: list[Filmed]) -> None:
    """The ball that is hit has one sample at the start, and its next one only when it is far on its way."""
    total = 0
    for shot in carom:
        balls = {b: without_short_moves(o, 0.014) for b, o in shot.clip.balls.items()}
        rare = replace(shot, clip=replace(shot.clip, balls=balls))
        meetings = [e.time for e in shot.motion.events if e.kind == "ball" and shot.clip.struck in e.balls]
        for first in meetings[:1]:
            time = balls[shot.clip.struck].time
            k = int(np.searchsorted(time, first))
            span = time[min(k + 1, len(time) - 1)] - time[max(k - 2, 0)]  # as near as two samples, some being left out
            assert np.abs(rare.cut_times(shot.clip.struck) - first).min(initial=np.inf) < max(2 / FPS, span)
            hit = onset(balls[next(b for b in balls if b != shot.clip.struck)], SIGMA, FPS)
            assert len(hit.time) < 3 or abs(hit.time[0] - first) < 3 / FPS
            total += 1
    assert total > 8


def test_a_ball_on_its_way_keeps_the_time_of_its_first_sample() -> None:
    """Only one that lay still until then may be said to start a frame before it is seen elsewhere."""
    keep = np.array([0, 2, 3, 4, 5, 6])
    time = keep / FPS
    moving = Observation(time, np.column_stack([1.5 * time, 0 * time]), np.full(6, np.nan))
    assert onset(moving, SIGMA, FPS).time == pytest.approx(time)
    lay = np.array([0, 1, 2, 6, 7, 8]) / FPS
    x = np.array([0, 0, 0, 0.01, 0.02, 0.03])
    struck = onset(Observation(lay, np.column_stack([x, 0 * x]), np.full(6, np.nan)), SIGMA, FPS)
    assert struck.time == pytest.approx(np.array([5, 6, 7, 8]) / FPS)
    assert struck.xy[0] == pytest.approx([0.0, 0.0])
