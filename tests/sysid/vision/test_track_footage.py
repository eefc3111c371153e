"""From footage to clips: pictures of what was seen, recordings, and the command, start to end."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path as File
from typing import cast

import cv2
import numpy as np
import pytest

from models.commands.console import Progress
from models.errors import BadInput
from models.model_file import full_model
from models.recording.video import Sightings, write_track
from models.shot import Shot, Table
from models.simulation.simulate import simulate
from sysid.cli.clips.track import track as cli_track
from sysid.clips import read_clip_set
from sysid.clips.trust import camera_doubts
from sysid.vision.balls.detect import Detector
from sysid.vision.camera.projection import write_camera
from sysid.vision.frames import Footage
from sysid.vision.preview import write_previews
from sysid.vision.tracks.clips import note
from sysid.vision.tracks.noise import residuals
from sysid.vision.tracks.track import Tracked, track
from tests.footage.cameras import overhead
from tests.footage.film import Look, film
from tests.footage.motion import motion_of
from tests.support.followed_balls import BALL, CAMERA, NAMES, TABLE, Drawn, Knowing, Recording


@pytest.fixture(scope="module")
def shown() -> tuple[Drawn, Tracked]:
    made = Recording().wait(0.4).shot((1.2, 0.45), seconds=1.0).wait(0.4).put(2, (0.2, 0.3)).wait(0.4)
    made.shot((-0.5, 0.3)).wait(0.4)
    footage, detector = Drawn(made), Knowing(made)
    result = track(cast(Footage, footage), CAMERA, cast(Detector, detector), {"white": 1}, lambda line: None)
    assert detector.asked[0] < 0.1 * footage.count < detector.asked[1]
    return footage, result


def test_the_whole_picture_is_searched_now_and_then(shown: tuple[Drawn, Tracked]) -> None:
    """Or a ball that is put on the table would not be found."""
    _, result = shown
    assert [path.name for path in result.scene.tracks if path.frame[-1] == len(result.scene.frames) - 1] != []
    assert len(result.shots) == 2
    assert all(len(shot.balls) == 3 for shot in result.shots)
    assert result.rate > 100


def test_a_picture_of_every_clip(tmp_path: File, shown: tuple[Drawn, Tracked]) -> None:
    footage, result = shown
    written = write_previews(tmp_path / "previews", cast(Footage, footage), result)
    assert [path.name for path in written] == ["0001.png", "0002.png"]
    picture = cv2.imread(str(written[0]))
    assert picture.shape == (480, 640, 3)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 50
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="is a file"):
        write_previews(tmp_path / "file", cast(Footage, footage), result)


def test_a_recording_of_the_footage(tmp_path: File, shown: tuple[Drawn, Tracked]) -> None:
    from rerun.chunk import RrdReader

    footage, result = shown
    scene = result.scene
    balls = {
        p.name: Sightings(p.frame, p.time, p.pixels, p.radius, p.xy, residuals(p.time, p.xy)) for p in scene.tracks
    }
    shots = [(scene.time_of(s.first), scene.time_of(s.last), note(k, s)) for k, s in enumerate(result.shots, 1)]
    (tmp_path / "fake.mp4").write_bytes(b"no video")
    write_track(
        tmp_path / "t.rrd", tmp_path / "fake.mp4", (scene.frames, scene.times),
        lambda: (frame.picture for frame in footage), balls, shots, TABLE, BALL.diameter,
    )  # fmt: skip
    rows: dict[str, int] = {}
    for chunk in RrdReader(tmp_path / "t.rrd").stream().to_chunks():
        rows[chunk.entity_path] = rows.get(chunk.entity_path, 0) + chunk.to_record_batch().num_rows
    assert rows["/picture/video"] == footage.count + 1
    for path in scene.tracks:
        assert rows[f"/picture/{path.name}"] > len(path.time)
        assert rows[f"/top/path/{path.name}"] == 3
        assert rows[f"/residual/{path.name}"] == len(path.time) + 1
    assert [file.name for file in tmp_path.iterdir() if file.name.startswith(".")] == []


def run(*words: str) -> int:
    return int(cli_track.main(words, standalone_mode=False, obj=Progress()))


def test_what_cannot_be_used_is_refused_before_the_work(tmp_path: File) -> None:
    (tmp_path / "set").mkdir()
    (tmp_path / "set" / "other.txt").write_text("mine")
    begin = ("v.mkv", "--camera", "c.toml", "--out")
    for given, words in (
        ((*begin, str(tmp_path / "set")), "already exists"),
        ((*begin, str(tmp_path / "set"), "--force"), "is not a clip set"),
        ((*begin, str(tmp_path / "new"), "--mass", "-1"), "--mass -1"),
        ((*begin, str(tmp_path / "new"), "--json", str(tmp_path / "no" / "f.json")), "folder does not exist"),
        ((*begin, str(tmp_path / "new"), "--preview", str(tmp_path / "set" / "other.txt")), "is a file"),
        ((*begin, str(tmp_path / "new")), "c.toml"),
    ):
        with pytest.raises(BadInput, match=words):
            run(*given)


@pytest.mark.slow
def test_from_video_to_clips(tmp_path: File, capsys: pytest.CaptureFixture[str]) -> None:
    table = Table(1.0, 0.55)
    flat = overhead(table, BALL.diameter, (480, 320), 1.6, 1.2, (0.02, -0.03))
    camera = dataclasses.replace(flat, distortion=np.array([-0.05, 0.01, 0.0, 0.0, 0.0]), doubts=("its edges",))
    write_camera(tmp_path / "camera.toml", camera)
    places, velocity = np.array([[-0.3, -0.1], [0.05, 0.02], [0.3, -0.15]]), np.zeros((3, 2))
    velocity[0] = [1.0, 0.33]
    shot = Shot(NAMES, places, velocity, np.zeros((3, 3)), np.linspace(0, 2, 2001))
    true = simulate(full_model(table, BALL), [shot], threads=1)[0]
    folder = tmp_path / "frames"
    folder.mkdir()
    times = np.arange(-0.4, 1.3, 1 / 60)
    for k, picture in enumerate(film(camera, motion_of(true), times, Look(exposure=0.002, noise=3.0))):
        cv2.imwrite(str(folder / f"{k:04d}.png"), picture)
    given = [str(folder), "--camera", str(tmp_path / "camera.toml"), "--out", str(tmp_path / "set"), "--fps", "60"]
    more = ["--rrd", str(tmp_path / "t.rrd"), "--preview", str(tmp_path / "p"), "--json", str(tmp_path / "t.json")]
    code = run(*given, *more)
    said = capsys.readouterr().out
    assert code == 0, said
    assert "mass 0.1406 kg" in said
    clip_set = read_clip_set(tmp_path / "set")
    (clip,), doubts = clip_set.clips, camera_doubts(clip_set)
    assert doubts == ("its edges",), "of the camera, which its clips carry on"
    assert clip.struck == "white"
    assert set(clip.balls) == set(NAMES)
    start = json.loads((tmp_path / "t.json").read_text())["clips"][0]["frames"][0]
    for k, name in enumerate(NAMES):
        seen = clip.balls[name]
        at = times[start] + seen.time
        right = np.column_stack([np.interp(at, true.times, true.position[:, k, axis]) for axis in (0, 1)])
        off = np.hypot(*(seen.xy - right).T)
        assert len(seen.time) == len(times) - start
        rms = float(np.sqrt(np.mean(off**2)))
        print(f"{name}: {1e3 * rms:.3f} mm, {rms / camera.radius * float(camera.radius_px(right[:1])[0]):.3f} px")
        assert rms < 4e-4, name
    assert (tmp_path / "t.rrd").stat().st_size > 1e5
    assert (tmp_path / "p" / "0001.png").is_file()
    assert run(*given) == 0
    assert "kept" in capsys.readouterr().out, "a finished video is not tracked again"
    (tmp_path / "broken.mkv").write_text("no video")
    with pytest.raises(BadInput, match=r"broken\.mkv: is not a readable video"):
        run(str(tmp_path / "broken.mkv"), *given)
    assert "kept" in capsys.readouterr().out, "the others go on"
