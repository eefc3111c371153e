"""Films of a clip set: found where they are, in the time of the clips, and no larger in a recording than is told."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

import models.recording.film
from models.errors import BadInput
from models.recording.film import playable_stamps
from sysid.cli import main
from sysid.clips import ClipSet, read_clip_set, write_clip_set
from sysid.vision.films import films_of, missing_line
from sysid.vision.tracks.clips import clip_set
from sysid.vision.tracks.recordings import of_video, place_of
from tests.support.films import FILM_RATE, grey, write_film
from tests.support.followed_balls import BALL, CAMERA, Recording, tracked_of
from tests.support.reviewed_clips import column, read, seconds


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A clip set of one clip, and the folder of its film."""
    folder = tmp_path_factory.mktemp("filmed")
    made = Recording(fps=FILM_RATE).wait(0.5).shot((1.2, 0.45), seconds=1.5).wait(0.3)
    found = tracked_of(made)
    (folder / "films").mkdir()
    write_film(folder / "films" / "game one.mp4", len(np.concatenate(made.rows)))
    place = place_of(str(folder / "films" / "game one.mp4"), folder / "set")
    one = of_video(clip_set(found, CAMERA, BALL.mass, FILM_RATE), "game_one", found, place, FILM_RATE)
    write_clip_set(one, folder / "set")
    return folder / "set", folder / "films"


def test_a_film_is_found_where_it_was_tracked_in_a_folder_and_beside(filmed: tuple[Path, Path], tmp_path: Path) -> None:
    clips, films = read_clip_set(filmed[0]), filmed[1]
    assert clips.extra["videos"][0]["file"] == "../films/game one.mp4"
    ((found,), missing) = films_of(clips)
    assert (found.video.resolve(), missing) == ((films / "game one.mp4").resolve(), [])
    unsaid = without_place(clips)
    assert films_of(unsaid) == ([], ["game_one"])
    assert films_of(unsaid, films)[0][0].video == films / "game one.mp4"
    moved = replace(unsaid, folder=films / "set")
    assert films_of(moved)[0][0].video == films / "game one.mp4", "beside the clip set"
    assert "--video DIR" in missing_line(["game_one"], None)
    assert "shown without" in missing_line(["game_one"], tmp_path)


def without_place(clips: ClipSet) -> ClipSet:
    """As it was written before clip sets told where their films are."""
    told = [{k: v for k, v in one.items() if k not in ("file", "fps")} for one in clips.extra["videos"]]
    return replace(clips, extra={**clips.extra, "videos": told})


def test_frames_are_in_the_time_of_the_clip(filmed: tuple[Path, Path]) -> None:
    clips = read_clip_set(filmed[0])
    clip = clips.clips[0]
    ((film,), _) = films_of(clips)
    index, time = film.clips[clip.file]
    samples = np.unique(np.concatenate([seen.time for seen in clip.balls.values()]))
    assert index[0] == clip.extra["frames"][0] and len(index) > 30
    assert np.abs(time[:, None] - samples).min(axis=0) == pytest.approx(0.0, abs=2e-6), "a frame for every sample"
    pictures = list(film.pictures(index[3:5].tolist()))
    assert [number for number, _ in pictures] == index[3:5].tolist()
    assert [int(picture.mean()) for _, picture in pictures] == pytest.approx([grey(k) for k in index[3:5]], abs=4)


def test_frames_of_a_clip_with_missing_ones_are_at_its_samples(filmed: tuple[Path, Path]) -> None:
    """Tracking finds frames missing though a video's stamps are even: the film must not run ahead."""
    clips = read_clip_set(filmed[0])
    (clip,) = clips.clips
    late = {n: replace(seen, time=seen.time + 0.05 * (seen.time > 0.5)) for n, seen in clip.balls.items()}
    moved = replace(clips, clips=(replace(clip, balls=late),))
    ((film,), _) = films_of(moved)
    _, time = film.clips[clip.file]
    samples = np.unique(np.concatenate([seen.time for seen in late.values()]))
    assert time[-len(samples) :] == pytest.approx(samples, abs=1e-6)


def test_what_is_not_the_film_is_refused(filmed: tuple[Path, Path], tmp_path: Path) -> None:
    clips = read_clip_set(filmed[0])
    write_film(tmp_path / "game one.mp4", 20)
    with pytest.raises(BadInput, match=r"lacks frames \d+ to \d+ of clips/game_one"):
        films_of(clips, tmp_path)
    with pytest.raises(BadInput, match="holds no film of game_one; name the folder"):
        films_of(clips, filmed[0])
    with pytest.raises(BadInput, match="no such folder"):
        films_of(clips, tmp_path / "nowhere")
    with pytest.raises(BadInput, match="does not say which films"):
        films_of(replace(clips, extra={}), tmp_path)


def test_the_film_stands_beside_the_table(
    filmed: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A codec that the viewer does not play goes in as pictures, not more and not wider than is told."""
    assert playable_stamps(filmed[1] / "game one.mp4") is None
    monkeypatch.setattr(models.recording.film, "MAX_PICTURES", 20)
    assert main(["review", str(filmed[0]), "--save", str(tmp_path / "r.rrd")]) == 0
    said = re.search(r"^film: (\d+) pictures of 1 video, one frame of (\d+), 0.\d MB$", capsys.readouterr().out, re.M)
    assert said
    count, step = map(int, said.groups())
    found = read(tmp_path / "r.rrd")
    blobs = column(found["/film/screen"], "EncodedImage:blob")
    assert 10 < len(blobs) == count <= 20
    picture = cv2.imdecode(np.array(blobs[0][0], np.uint8), cv2.IMREAD_COLOR)
    assert picture.shape == (360, 640, 3)
    clip = read_clip_set(filmed[0]).clips[0]
    ((film,), _) = films_of(read_clip_set(filmed[0]))
    index, time = film.clips[clip.file]
    assert seconds(found["/film/screen"]) == pytest.approx(time[::step], abs=1e-6)
    assert picture.mean() == pytest.approx(grey(index[0]), abs=4)
    assert "Film: " in column(found["/text/clips"], "TextDocument:text")[0][0]


def test_a_video_that_the_viewer_plays_goes_in_as_it_is(
    filmed: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = filmed[1] / "game one.mp4"
    stamps = np.arange(400) * round(1e9 / FILM_RATE)
    monkeypatch.setattr(models.recording.film, "playable_stamps", lambda video: stamps)
    assert main(["review", str(filmed[0]), "--save", str(tmp_path / "r.rrd")]) == 0
    found = read(tmp_path / "r.rrd")
    (blob,) = column(found["/film/video/1"], "AssetVideo:blob")
    assert bytes(blob[0]) == path.read_bytes()
    ((film,), _) = films_of(read_clip_set(filmed[0]))
    ((index, time),) = film.clips.values()
    shown = [row[0] for row in column(found["/film/screen"], "VideoFrameReference:timestamp")]
    assert shown == stamps[index].tolist()
    assert set(map(tuple, column(found["/film/screen"], "VideoFrameReference:video_reference"))) == {("/film/video/1",)}
    assert seconds(found["/film/screen"]) == pytest.approx(time, abs=1e-6)
    monkeypatch.setattr(models.recording.film, "MAX_VIDEO_BYTES", 10)
    assert main(["review", str(filmed[0]), "--save", str(tmp_path / "small.rrd")]) == 0
    assert "/film/video/1" not in read(tmp_path / "small.rrd"), "too large to go in whole"


def test_a_clip_set_without_its_film_is_shown_and_says_so(
    filmed: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clips = read_clip_set(filmed[0])
    write_clip_set(without_place(clips), tmp_path / "set")
    assert main(["review", str(tmp_path / "set"), "--save", str(tmp_path / "r.rrd")]) == 0
    assert "film not found of game_one: give its folder with --video DIR\n" in capsys.readouterr().out
    assert not [path for path in read(tmp_path / "r.rrd") if path.startswith("/film")]
    assert main(["review", str(tmp_path / "set"), "--save", str(tmp_path / "s.rrd"), "--video", str(tmp_path)]) == 2
    assert "holds no film of game_one" in capsys.readouterr().err
    assert not (tmp_path / "s.rrd").exists()
