"""`sysid track`: from a video to a clip set."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from models.console import DONE, FOUND, Progress, Verb, check_outputs, table, write_json
from models.errors import BadInput

if TYPE_CHECKING:
    from sysid.vision.camera.projection import Camera
    from sysid.vision.details import Details
    from sysid.vision.frames import Footage
    from sysid.vision.tracks.track import Tracked

USUAL = 0.1406 / 0.0525**3  # mass of a snooker ball over the cube of its diameter [kg/m^3]
HEAD = ("clip", "time [s]", "struck", "balls", "samples", "lost", "speed [m/s]", "noise [mm]", "remark")


def register(verb: Verb) -> None:
    """The verb with its options."""
    one = verb("track", run, "from a video to a clip set")
    one.add_argument("video", metavar="VIDEO", help="video, folder of pictures, or pattern of their names (%%04d or *)")
    one.add_argument("--camera", metavar="CAM.toml", required=True, help="camera file, made with: sysid calibrate")
    one.add_argument("--out", metavar="CLIPS", required=True, help="folder for the clip set")
    text = "rate at which the frames were taken, where the video does not know it [1/s]"
    one.add_argument("--fps", metavar="F", type=float, help=text)
    one.add_argument("--palette", metavar="P.toml", help="names and colours of the balls (default: those of snooker)")
    one.add_argument("--mass", metavar="M", type=float, help="of a ball [kg] (default: of a snooker ball of its size)")
    one.add_argument("--rrd", metavar="R.rrd", help="video, detections, tracks and residuals for Rerun")
    one.add_argument("--preview", metavar="DIR", help="folder for a picture of each clip")
    one.add_argument("--json", metavar="FILE", help="the same figures as JSON")
    one.add_argument("--force", action="store_true", help="replace a clip set that is there")


def run(args: argparse.Namespace, progress: Progress) -> int:
    """Detect, follow, split, write."""
    _check(args)
    import cv2

    from sysid.vision.balls.detect import Detector
    from sysid.vision.balls.palette import default_palette, read_palette
    from sysid.vision.camera.projection import read_camera
    from sysid.vision.details import details
    from sysid.vision.frames import open_footage
    from sysid.vision.tracks.track import track

    cv2.setNumThreads(1)  # pictures are small: threads only wait for each other
    camera = read_camera(args.camera)
    palette = read_palette(args.palette) if args.palette else default_palette()
    footage = open_footage(args.video, args.fps)
    if footage.size != tuple(camera.size):
        sizes = " and ".join(f"{w} x {h}" for w, h in (footage.size, camera.size))
        raise BadInput(f"{args.video}: {sizes} pixels in video and {args.camera}; calibrate with this video's frames")
    detector = Detector.learn(camera, footage, palette, progress)
    result = track(footage, camera, detector, dict(zip(palette.names, palette.counts, strict=True)), progress)
    result, seen = details(result, footage, camera, progress)
    progress.close()
    mass = args.mass if args.mass is not None else USUAL * camera.diameter**3
    told = [*footage.assumed, *detector.notes, *result.notes]
    if args.mass is None:
        told.append(f"mass {mass:.4f} kg, that of a snooker ball of this size: give yours with --mass")
    _print(result, told)
    _print_details(seen)
    _write(args, result, seen, footage, camera, mass, progress)
    if args.json:
        write_json(args.json, to_json(args.video, result, told, seen))
    for doubt in result.doubts:
        print(f"not to be trusted: {doubt}")
    return FOUND if result.doubts else DONE


def _check(args: argparse.Namespace) -> None:
    """Refuse before the work what could not be used, or written, after it."""
    check_outputs(args.rrd, args.json)
    out = Path(args.out)
    if out.exists() and not args.force and (not out.is_dir() or any(out.iterdir())):
        raise BadInput(f"{args.out}: is there already; choose another folder, or replace a clip set with --force")
    if out.is_dir() and any(out.iterdir()) and not (out / "clips.toml").is_file():
        raise BadInput(f"{args.out}: holds something else than a clip set; choose another folder")
    if args.preview and Path(args.preview).exists() and not Path(args.preview).is_dir():
        raise BadInput(f"{args.preview}: is a file; name a folder for the pictures of clips")
    if args.mass is not None and not 0 < args.mass < float("inf"):
        raise BadInput(f"--mass {args.mass:g}: must be a ball's mass in kg, above 0")


def rows(result: Tracked) -> list[dict[str, Any]]:
    """What there is to say of each clip."""
    from sysid.vision.tracks.track import lost_frames

    found = []
    for number, (shot, seen) in enumerate(zip(result.shots, result.found, strict=True), 1):
        lost = {name: lost_frames(result.scene, shot, path, which) for name, (path, which) in seen.items()}
        found.append({
            "clip": number, "time": shot.time, "struck": shot.struck, "balls": list(seen),
            "samples": {name: int(which.size) for name, (_, which) in seen.items()}, "lost": lost,
            "speed": shot.speed, "remarks": list(shot.remarks), "frames": [shot.first, shot.last],
        })  # fmt: skip
    return found


def to_json(video: str, result: Tracked, told: Sequence[str], seen: Sequence[Details]) -> dict[str, Any]:
    """All figures."""
    clips = [{**row, **_detail(one)} for row, one in zip(rows(result), seen, strict=True)]
    return {
        "format": "billiard-track/1", "video": video, "frames": len(result.scene.frames), "rate": result.rate,
        "noise": {"moving": result.noise.moving, "resting": result.noise.resting, "sigma": result.noise.sigma},
        "clips": clips, "left_out": list(result.left_out), "told": list(told), "doubts": list(result.doubts),
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


def _count(values: NDArray[np.float64]) -> int:
    """How many are known."""
    return int(np.isfinite(values).sum())


def _print_details(seen: Sequence[Details]) -> None:
    """What was seen of cues and marks, a line each."""
    for number, one in enumerate(seen, 1):
        if one.tip:
            print(f"clip {number}: {one.tip}")
        for text in one.cue.notes if one.cue else ():
            print(f"clip {number}: cue: {text}")
        for name, turned in one.turned.items():
            count, kept = _count(turned.theta), _count(turned.steady)
            first = turned.sidespin
            rate = f", at first {first.spin:+.2f} +- {first.spin_sd:.2f} rad/s" if first is not None else ""
            print(f"clip {number}: {name}: turned angle in {count} of {len(turned.theta)} pictures{rate}")
            if kept < count:
                why = f"rolling may lead it astray, by {np.nanmax(turned.drift):.2f} rad at the end"
                print(f"clip {number}: {name}: {kept or 'none'} of these angles go into the clip: {why}")
            for text in turned.notes:
                print(f"clip {number}: {name}: {text}")


def _print(result: Tracked, told: Sequence[str]) -> None:
    """The table of clips and what else there is to say."""
    for text in told:
        print(text)
    noise = result.noise
    print(f"{len(result.scene.frames)} frames, {result.rate:.0f} frames/s, {len(result.scene.tracks)} balls")
    print(f"noise {1e3 * noise.moving:.3f} mm moving, {1e3 * noise.resting:.3f} mm resting\n")
    lines = [HEAD]
    for row in rows(result):
        lines.append((
            str(row["clip"]), f"{row['time']:.2f}", row["struck"], " ".join(row["balls"]),
            str(sum(row["samples"].values())), str(sum(row["lost"].values())), f"{row['speed']:.3f}",
            f"{1e3 * noise.sigma:.3f}", "; ".join(row["remarks"]),
        ))  # fmt: skip
    if len(lines) > 1:
        print(table(lines))
    for text in result.left_out:
        print(text)


def _write(
    args: argparse.Namespace, result: Tracked, seen: Sequence[Details], footage: Footage, camera: Camera, mass: float,
    progress: Progress,
) -> None:  # fmt: skip
    """The clip set, and pictures and recording where asked."""
    from sysid.clips import write_clip_set
    from sysid.vision.tracks.clips import Extra, clip_set

    if result.shots:
        extras = [Extra({n: t.steady for n, t in one.turned.items()}, one.tip) for one in seen]
        write_clip_set(clip_set(result, camera, mass, footage.fps, extras), args.out)
        print(f"\nclips: {args.out}")
    if args.preview:
        from sysid.vision.preview import write_previews

        written = write_previews(args.preview, footage, result, progress)
        progress.close()
        print(f"pictures: {len(written)} in {args.preview}")
    if args.rrd:
        progress("writing the recording")
        _record(args, result, footage, camera)
        progress.close()
        print(f"recording: {args.rrd} (open it with: rerun {args.rrd})")


def _record(args: argparse.Namespace, result: Tracked, footage: Footage, camera: Camera) -> None:
    """The recording for Rerun."""
    from models.recording.video import Sightings, write_track
    from sysid.vision.tracks.clips import note
    from sysid.vision.tracks.noise import residuals

    scene = result.scene
    balls = {
        p.name: Sightings(p.frame, p.time, p.pixels, p.radius, p.xy, residuals(p.time, p.xy)) for p in scene.tracks
    }
    shots = [(scene.time_of(s.first), scene.time_of(s.last), note(k, s)) for k, s in enumerate(result.shots, 1)]
    try:
        write_track(
            args.rrd, args.video, (scene.frames, scene.times), lambda: (frame.picture for frame in footage), balls,
            shots, camera.table, camera.diameter,
        )  # fmt: skip
    except OSError as error:
        raise BadInput(f"{args.rrd}: the recording cannot be written ({error.strerror or error})") from error
