"""`sysid track`: from a video to a clip set."""

from __future__ import annotations

import math
import os
from collections.abc import Generator, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from models.command_line import (
    ABOVE_ZERO,
    FILE_PATH,
    ZERO_OR_MORE,
    gathered,
    given,
    json_option,
    output_option,
    scheduler_option,
)
from models.console import Progress, Status, table, write_json
from models.errors import BadInput
from models.files import alone_in
from sysid.cli.common import camera_option, mass_option, palette_option, print_recording, rrd_option
from sysid.cli.viewing import Live

if TYPE_CHECKING:
    from models.recording.viewer import Feed
    from sysid.vision.camera.projection import Camera
    from sysid.vision.details import Details
    from sysid.vision.film import TrackedFilm
    from sysid.vision.frames import Footage
    from sysid.vision.tracks.track import Tracked

JSON_FORMAT = "billiard-track/1"
TABLE_HEAD = ("clip", "time [s]", "struck", "balls", "samples", "lost", "speed [m/s]", "noise [mm]", "remark")


@dataclass(frozen=True)
class Filmed:
    """Videos of one camera with what is known of them."""

    videos: tuple[str, ...] = given(click.argument("videos", metavar="VIDEO...", nargs=-1, required=True))
    camera_file: Path = given(camera_option(required=True))
    fps: float | None = given("--fps", "F", "Frames taken in a second, where the video does not say so.", ABOVE_ZERO)
    exposure: float | None = given(
        "--exposure",
        "S",
        "Exposure of a frame [s]; by default estimated from the sweep of moving balls.",
        ABOVE_ZERO,
    )
    readout: float | None = given(
        "--readout",
        "S",
        "Time from a picture's first row to its last, 0 for a global shutter; by default as the camera file says.",
        ZERO_OR_MORE,
    )
    palette_file: Path | None = given(palette_option)
    mass: float | None = given(mass_option)
    scheduler: str | None = given(scheduler_option)


@dataclass(frozen=True)
class TrackOutputs:
    """What tracking writes."""

    out: Path = given("--out", "CLIPS", "Folder for the clip set; clips join those of finished videos.", FILE_PATH,
                      required=True)  # fmt: skip
    force: bool = given("--force", "", "Replace a clip set that is there.", bool)
    json_file: Path | None = given(json_option)
    rrd_file: Path | None = given(rrd_option)
    preview: Path | None = given("--preview", "DIR", "Folder for a picture of each clip.", FILE_PATH)
    sheet_file: Path | None = given(output_option("sheet", "SHEET.png", "Draw a contact sheet: a row a shot."))

    def check(self) -> None:
        """Refuse before the work what could not be written after it."""
        from sysid.vision.tracks.recordings import finished

        out = self.out
        begun = out.is_dir() and (out / "clips.toml").is_file() and finished(out) is not None
        if out.exists() and not self.force and not begun and (not out.is_dir() or any(out.iterdir())):
            raise BadInput(f"{out}: is there already; choose another folder, or replace a clip set with --force")
        if out.is_dir() and any(out.iterdir()) and not (out / "clips.toml").is_file():
            raise BadInput(f"{out}: holds something else than a clip set; choose another folder")
        if self.preview and self.preview.exists() and not self.preview.is_dir():
            raise BadInput(f"{self.preview}: is a file; name a folder for the pictures of clips")


@click.command()
@gathered("filmed", Filmed)
@gathered("outputs", TrackOutputs)
@gathered("live", Live)
@click.pass_obj
def track(progress: Progress, filmed: Filmed, outputs: TrackOutputs, live: Live) -> int:
    """Track the balls of videos of one camera, and write their shots as a clip set.

    VIDEO is a video, a folder of pictures, or a pattern of their names (%04d or *). Reads each and the camera file, and
    writes a clip for each shot, named by video and time. Videos that the clip set holds already are not read again.
    With --live each frame is shown with the balls found in it. Status 1 if the tracks are not to be trusted.

    Example: sysid track match.mp4 --camera cam.toml --out CLIPS
    """
    outputs.check()
    click.get_current_context().with_resource(alone_in(outputs.out))
    import cv2

    from sysid.clips import write_clip_set
    from sysid.clips.trust import tell_doubts
    from sysid.vision.camera.projection import read_camera
    from sysid.vision.tracks.recordings import check_camera, finished, joined, names_of, of_video, place_of, videos_in

    named = names_of(filmed.videos)
    if outputs.rrd_file and len(named) > 1:
        raise BadInput("--rrd: records one video; give one video, or leave it out")
    if live.live and filmed.scheduler is not None:
        raise BadInput("--live shows what this machine tracks; leave it out, or leave --scheduler out")
    cv2.setNumThreads(1)  # pictures are small: threads only wait for each other
    camera = read_camera(filmed.camera_file)
    tell_doubts(filmed.camera_file, camera.doubts)
    camera = camera if filmed.readout is None else replace(camera, readout=filmed.readout)
    so_far = None if outputs.force else finished(outputs.out)
    if so_far is not None:
        check_camera(so_far, camera, outputs.out)
    reports, refused, doubtful = [], list[BadInput](), False
    done = videos_in(so_far)
    feed = click.get_current_context().with_resource(live.feed())
    films = _films(progress, filmed, camera, [video for name, video in named.items() if name not in done], feed)
    click.get_current_context().call_on_close(films.close)
    for name, video in named.items():
        if len(named) > 1:
            print(f"\n{video}")
        if name in done:
            print(f"{name}: its clips are in {outputs.out}, kept; track it anew with --force")
            continue
        try:
            film = next(films)[1]
        except KeyboardInterrupt as end:
            if so_far is not None:
                end.add_note(f"{len(videos_in(so_far))} videos are kept in {outputs.out}: the same command continues")
            raise
        if isinstance(film, BadInput):
            refused.append(film)
            progress.close()
            if len(named) > 1:
                print(f"left out: {film}")
            continue
        result = film.result
        reports.append(_report(progress, filmed, outputs, video, camera, film))
        doubtful |= bool(result.doubts)
        if film.clips is not None:
            so_far = joined(so_far, of_video(film.clips, name, result, place_of(video, outputs.out), film.fps))
            write_clip_set(so_far, outputs.out)
            print(f"\nclips: {outputs.out}")
        for doubt in result.doubts:
            print(f"not to be trusted: {doubt}")
    if outputs.json_file and reports:
        write_json(outputs.json_file, reports[0] if len(named) == 1 else {"format": JSON_FORMAT, "videos": reports})
    if outputs.sheet_file and so_far is not None:
        from sysid.vision.sheet import write_sheet

        progress("drawing the contact sheet")
        write_sheet(outputs.sheet_file, so_far, camera, named, filmed.fps)
        progress.close()
        print(f"contact sheet: {outputs.sheet_file}")
    if refused:
        raise refused[0]
    return Status.FINDING if doubtful else Status.DONE


def _films(
    progress: Progress, filmed: Filmed, camera: Camera, videos: Sequence[str], feed: Feed | None
) -> Generator[tuple[str, TrackedFilm | BadInput], None, None]:
    """Videos with what became of them, in order; tracked by a cluster where it has an address."""
    from models.workers import open_workers
    from sysid.vision.balls.palette import palette_for
    from sysid.vision.film import Taken, film_mark, track_same_film, tried_film
    from sysid.vision.tracks.recordings import video_name

    palette = palette_for(filmed.palette_file, camera.table, camera.diameter)
    taken = Taken(camera, str(filmed.camera_file), palette, filmed.fps, filmed.exposure, filmed.mass)
    if filmed.scheduler is None:
        for video in videos:
            yield video, tried_film(video, taken, progress, feed)
        return
    tasks = [(os.path.abspath(video), video_name(video), taken, film_mark(video)) for video in videos]
    with open_workers(filmed.scheduler, 0, progress=progress) as workers:
        yield from zip(videos, workers.in_turn(track_same_film, tasks), strict=True)


def _report(
    progress: Progress, filmed: Filmed, outputs: TrackOutputs, video: str, camera: Camera, film: TrackedFilm
) -> dict[str, Any]:  # fmt: skip
    """All figures of a film, after it was printed, and drawn where asked."""
    from sysid.vision.frames import open_footage

    result = film.result
    progress.close()
    _print(result, film.remarks)
    _print_details(film.seen)
    if outputs.preview or outputs.rrd_file:
        _draw(outputs, video, result, open_footage(video, filmed.fps), camera, progress)
    return to_json(video, result, film.remarks, film.seen)


def rows(result: Tracked) -> list[dict[str, Any]]:
    """What the table and the JSON file say of each clip."""
    from sysid.vision.tracks.track import lost_frames

    found = []
    for number, (shot, seen) in enumerate(zip(result.shots, result.found, strict=True), 1):
        lost = {name: lost_frames(result.scene, shot, path, which) for name, (path, which) in seen.items()}
        found.append({
            "clip": number, "time": shot.time, "struck": None if shot.running else shot.struck,
            "running": list(shot.running), "balls": list(seen),
            "samples": {name: int(which.size) for name, (_, which) in seen.items()}, "lost": lost,
            "speed": shot.speed, "remarks": list(shot.remarks), "frames": [shot.first, shot.last],
        })  # fmt: skip
    return found


def to_json(video: str, result: Tracked, remarks: Sequence[str], seen: Sequence[Details]) -> dict[str, Any]:
    """All figures."""
    clips = [{**row, **_detail(one)} for row, one in zip(rows(result), seen, strict=True)]
    return {
        "format": JSON_FORMAT, "video": video, "frames": len(result.scene.frames), "rate": result.rate,
        "noise": {"moving": result.noise.moving, "resting": result.noise.resting, "sigma": result.noise.sigma,
                  "balls": dict(result.noise.balls)},
        "places": {"rms": result.places.rms, **asdict(result.places)},
        "clips": clips, "left_out": list(result.left_out), "told": list(remarks), "doubts": list(result.doubts),
    }  # fmt: skip


def _detail(one: Details) -> dict[str, Any]:
    """Cue and marks of a clip."""
    c = one.cue
    cue = None if c is None else {
        "speed": c.speed, "speed_sd": c.speed_sd, "azimuth": c.azimuth, "azimuth_sd": c.azimuth_sd, "side": c.side,
        "side_sd": c.side_sd, "contact": c.contact, "told": list(c.notes),
    }  # fmt: skip
    marks = {}
    for name, t in one.turned.items():
        marks[name] = {"angles": _count(t.theta), "kept": _count(t.steady), "told": list(t.notes), "sidespin": None}
        if (first := t.sidespin) is not None:
            marks[name]["sidespin"] = {
                "from": first.start, "to": first.end, "value": first.spin, "sd": first.spin_sd,
            }  # fmt: skip
    return {"cue": cue, "marks": marks}


def _count(values: Iterable[float]) -> int:
    """How many are known."""
    return sum(math.isfinite(value) for value in values)


def _print_details(seen: Sequence[Details]) -> None:
    """Print what was seen of cues and marked balls, a line each."""
    for number, one in enumerate(seen, 1):
        if one.tip:
            print(f"clip {number}: {one.tip}")
        for text in one.cue.notes if one.cue else ():
            print(f"clip {number}: cue: {text}")
        for name, turned in one.turned.items():
            count, used = _count(turned.theta), _count(turned.steady)
            first = turned.sidespin
            rate = f", at first {first.spin:+.2f} +- {first.spin_sd:.2f} rad/s" if first is not None else ""
            print(f"clip {number}: {name}: turned angle in {count} of {len(turned.theta)} pictures{rate}")
            if used < count:
                drift = max(d for d in turned.drift if d == d)
                print(
                    f"clip {number}: {name}: {used or 'none'} of these angles are written into the clip: rolling may "
                    f"falsify the others, by {drift:.2f} rad at the end"
                )
            for text in turned.notes:
                print(f"clip {number}: {name}: {text}")


def _print(result: Tracked, remarks: Sequence[str]) -> None:
    """Print the remarks, the noise and a table of the clips."""
    for text in remarks:
        print(text)
    noise = result.noise
    print(f"{len(result.scene.frames)} frames, {result.rate:.0f} frames/s, {len(result.scene.tracks)} balls")
    print(noise.text())
    each = ", ".join(f"{name} {1e3 * sd:.3f} mm" for name, sd in noise.balls.items())
    if each:
        print(f"moving: {each}")
    print(f"{result.places.text()}\n" if result.shots else "")
    lines = [TABLE_HEAD]
    for row in rows(result):
        lines.append((
            str(row["clip"]), f"{row['time']:.2f}", row["struck"] or "unseen", " ".join(row["balls"]),
            str(sum(row["samples"].values())), str(sum(row["lost"].values())), f"{row['speed']:.3f}",
            f"{1e3 * noise.sigma:.3f}" if math.isfinite(noise.sigma) else "-", "; ".join(row["remarks"]),
        ))  # fmt: skip
    if len(lines) > 1:
        print(table(lines))
    for text in result.left_out:
        print(text)


def _draw(
    outputs: TrackOutputs, video: str, result: Tracked, footage: Footage, camera: Camera, progress: Progress
) -> None:  # fmt: skip
    """Pictures and recording where asked."""
    if outputs.preview:
        from sysid.vision.preview import write_previews

        written = write_previews(outputs.preview, footage, result, progress)
        progress.close()
        print(f"pictures: {len(written)} in {outputs.preview}")
    if outputs.rrd_file:
        progress("writing the recording")
        _record(outputs.rrd_file, video, result, footage, camera)
        progress.close()
        print_recording(outputs.rrd_file)


def _record(path: Path, video: str, result: Tracked, footage: Footage, camera: Camera) -> None:
    """The recording for Rerun."""
    from models.recording.video import Sightings, write_track
    from sysid.vision.tracks.clips import note
    from sysid.vision.tracks.noise import residuals

    scene = result.scene
    balls = {
        p.name: Sightings(p.frame, p.time, p.pixels, p.radius, p.xy, residuals(p.time, p.xy)) for p in scene.tracks
    }
    shots = [(scene.time_of(s.first), scene.time_of(s.last), note(k, s)) for k, s in enumerate(result.shots, 1)]
    write_track(
        path, video, (scene.frames, scene.times), lambda: (frame.picture for frame in footage), balls,
        shots, camera.table, camera.diameter,
    )  # fmt: skip
