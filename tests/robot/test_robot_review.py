"""What `robot review` shows of a series and of a campaign, and a series in the viewer while it is played."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import robot.learning.loop
from models.analytic.cue_impulse import Constants, Geometry, ball_speed_and_squirt
from models.recording.story import LiveStory
from models.table.snooker import SNOOKER_BALL
from planner.launcher.cueing_map import write_map
from robot.cli.verbs import main
from robot.cueing.campaign import CueShot, run_campaign
from robot.learning.history import fit_folder, plan_file, read_history
from robot.learning.loop import learn
from robot.learning.report import recording_of, write_recording
from robot.learning.watch import SeriesWatch
from robot.play import FilmedFrames, add_clip, played_file
from sysid.clips import ClipSet, CueCommand, Observation, read_clip_set, write_clip_set
from sysid.vision.films import films_of
from tests.support.films import FILM_RATE, write_film
from tests.support.live_feed import FileFeed
from tests.support.quick_plans import QUICK
from tests.support.reviewed_clips import column, read
from tests.support.series_samples import COURSE, MAP, STAND, series
from tests.support.story_samples import sample_story

GRID = [(100, 0.0, 0.0), (100, 6.0, 4.0), (150, 0.0, -4.0)]


def strike(string: int, x0_mm: float, y0_mm: float) -> CueShot:
    """A stroke of a cue that is 10 mm/s faster and 1 mrad farther to the left than a regular one."""
    speed, squirt = ball_speed_and_squirt(
        Constants(), Geometry(SNOOKER_BALL), np.array([1.5]), np.array([1e-3 * x0_mm]), np.array([1e-3 * y0_mm])
    )
    return CueShot(string, 1.5, x0_mm, y0_mm, float(speed[0]) + 0.01, 0.01, 0.0, float(squirt[0]) + 1e-3, 1e-3, 0.0,
                   miscue=string == 150)  # fmt: skip


def test_a_campaign_is_held_against_its_map(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run_campaign(strike, tmp_path / "shots.csv", 3, grid=GRID)
    assert main(["review", str(tmp_path / "shots.csv"), "--save", str(tmp_path / "c.rrd")]) == 0
    found = read(tmp_path / "c.rrd")
    played = [GRID[k] for k in np.random.default_rng(3).permutation(3)]
    places = [row[0] for row in column(found["/face/this"], "Ellipses2D:centers")]
    assert places == [pytest.approx([x, -y]) for _, x, y in played], "in the order in which they were played"
    for part, want in (("speed", 10.0), ("squirt", 1.0)):
        misses = np.array(column(found[f"/miss/{part}"], "Scalars:scalars"), float).ravel()
        assert misses[np.isfinite(misses)] == pytest.approx([want, want], abs=1e-4), "without the miscue"
    assert "3 strokes, 1 of them miscues" in column(found["/text/campaign"], "TextDocument:text")[0][0]
    moved = dataclasses.replace(MAP, constants=dataclasses.replace(Constants(), aim_zero=0.003))
    write_map(tmp_path / "map.toml", moved)
    more = ["--map", str(tmp_path / "map.toml"), "--save", str(tmp_path / "m.rrd")]
    assert main(["review", str(tmp_path / "shots.csv"), *more]) == 0
    misses = np.array(column(read(tmp_path / "m.rrd")["/miss/squirt"], "Scalars:scalars"), float).ravel()
    assert misses[np.isfinite(misses)] == pytest.approx([-2.0, -2.0], abs=0.05)
    assert main(["review", str(tmp_path), *more[:2], "--save", str(tmp_path / "series.rrd")]) == 2
    assert "applies to a campaign" in capsys.readouterr().err


@pytest.fixture(scope="module")
def watched(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Any], list[int]]:
    """A short series that was watched, broken off and continued: its folder, recordings, and what was reported."""
    folder = tmp_path_factory.mktemp("watched")
    config, told, recordings = dataclasses.replace(COURSE, effort=QUICK), [], []
    for shots in (1, 2):
        (folder / str(shots)).mkdir()
        feed = FileFeed(folder / str(shots))
        course = dataclasses.replace(config, shots=shots)
        robot.learning.loop.begin(folder / "series", course)
        watch = SeriesWatch(folder / "series", feed, course.model.table, course.model.ball)

        def both(number: int, watch: SeriesWatch = watch) -> None:
            told.append(number)
            watch(number)

        stand = dataclasses.replace(STAND, repeats=0)
        learn(folder / "series", course, stand, lambda line: None, watch=both)
        recordings += [read(path) for path in feed.files()]
    return folder / "series", recordings, told


@pytest.mark.slow
def test_a_series_is_shown_while_it_is_played(watched: tuple[Path, list[Any], list[int]]) -> None:
    folder, (first, second), told = watched
    assert told == [1, 1, 2, 2]
    lines = [row[0] for row in column(first["/log/shot"], "TextLog:text")]
    assert len(lines) == 2 and lines[0].startswith("shot 1: planned, ") and "missed by" in lines[1]
    story = read_history(folder)
    stops = series(first["/top/stopped"], "Ellipses2D:centers")
    assert stops[1][0] == [] and stops[1][1][0] == pytest.approx(story.shots[0].cue_end, abs=1e-5)
    assert [len(rows) for rows in series(first["/plot/miss"], "Scalars:scalars").values()] == [1]
    lines = [row[0] for row in column(second["/log/shot"], "TextLog:text")]
    assert [line[:6] for line in lines] == ["shot 1", "shot 2", "shot 2"], "what was played before is shown first"
    targets = series(second["/top/target"], "LineStrips2D:strips")
    for shot in story.shots:
        assert np.mean(targets[shot.number][-1], axis=(0, 1)) == pytest.approx(shot.planned_end, abs=1e-5)
    plan = json.loads(plan_file(folder, 2).read_text())
    moving = {track["ball"] for track in plan["tracks"]}
    assert {path.rpartition("/")[2] for path in second if path.startswith("/top/planned/")} >= moving
    assert not fit_folder(folder, 1).exists() and played_file(plan_file(folder, 2)).is_file()


def test_a_shot_that_is_shown_again_is_logged_once(tmp_path: Path) -> None:
    """After a refit the last shot is shown anew, with what was found."""
    story = recording_of(sample_story())
    feed = FileFeed(tmp_path)
    live = LiveStory(feed, "t", story.table, story.ball)
    last = dataclasses.replace(story, scenes=story.scenes[-1:], lessons=())
    live.show(last)
    live.show(dataclasses.replace(last, lessons=((story.scenes[-1].number, "refit"),)))
    [found] = [read(path) for path in feed.files()]
    assert len(column(found["/log/shot"], "TextLog:text")) == 1
    assert [row[0] for row in column(found["/log/refit"], "TextLog:text")] == ["refit"]


def test_films_of_a_rig_stand_beside_its_shots(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A clip of a camera tells its film, which the review of the series shows in the shot's time."""
    write_film(tmp_path / "films" / "film-0001.mkv", 80)
    story = sample_story()
    shot = next(one for one in story.shots if one.clip is not None)
    assert shot.clip is not None
    balls, rate = {name: at_rate(seen, FILM_RATE) for name, seen in shot.clip.balls.items()}, FILM_RATE
    begun = ClipSet(shot.scene.table, shot.scene.ball, rate, (), 1e-3, tmp_path / "clips")
    count = len(next(iter(balls.values())).time)
    filmed = FilmedFrames(tmp_path / "films" / "film-0001.mkv", 5, 4 + count)
    log = add_clip(begun, balls, next(iter(balls)), CueCommand(1.0, 0.0), "played", filmed)
    again = add_clip(log, balls, next(iter(balls)), CueCommand(1.0, 0.0), "played", filmed)
    assert [clip.extra["video"] for clip in again.clips] == ["film-0001", "film-0001-again"]
    write_clip_set(log, tmp_path / "clips")
    clips = read_clip_set(tmp_path / "clips")
    films, missing = films_of(clips)
    assert not missing
    shown = dataclasses.replace(shot, clip=clips.clips[0])
    told = write_recording(tmp_path / "s.rrd", dataclasses.replace(story, shots=(shown,)), films=films)
    assert told.startswith(f"{count} pictures of 1 video")
    screen = read(tmp_path / "s.rrd")["/film/screen"]
    assert len(series(screen, "EncodedImage:blob")[shot.number]) == count
    (tmp_path / "c.csv").write_text("")
    words = ["--video", str(tmp_path), "--save", str(tmp_path / "c.rrd")]
    assert main(["review", str(tmp_path / "c.csv"), *words]) == 2
    assert "applies to a series" in capsys.readouterr().err


def at_rate(seen: Observation, rate: float) -> Observation:
    """The track at the frames of a camera."""
    times = np.arange(40) / rate
    xy = np.column_stack([np.interp(times, seen.time, seen.xy[:, k]) for k in (0, 1)])
    return Observation(times, xy, np.full(len(times), np.nan))


@pytest.mark.slow
def test_a_series_that_is_not_finished_is_reviewed(watched: tuple[Path, list[Any], list[int]], tmp_path: Path) -> None:
    (watched[0] / "ended.txt").unlink(missing_ok=True)
    assert main(["review", str(watched[0]), "--save", str(tmp_path / "s.rrd")]) == 0
    found = read(tmp_path / "s.rrd")
    assert [row[0][:6] for row in column(found["/log/shot"], "TextLog:text")] == ["shot 1", "shot 2"]
