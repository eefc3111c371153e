"""Random films, calibrated and tracked as a newcomer would: `python -m tests.footage.study --films 200`.

Each film is a few shots of the independent generator under a random camera, lens, lamp, cloth, wood, exposure, frame
rate and codec. `sysid calibrate` and `sysid track` see the film alone, with the sizes of table and ball. Out: one line
a film, and a table of rates and errors. A film is finished once its result lies in the folder, so a run can go on.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import json
import shutil
import sys
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np

from models.commands.console import table
from models.shot import Array
from sysid.cli.verbs import main as sysid
from sysid.clips import read_clip_set
from sysid.vision.camera.projection import Camera, read_camera, write_camera
from tests.footage.__main__ import camera_over, moments, pictures
from tests.footage.cameras import aimed
from tests.footage.film import Look
from tests.footage.scenes import Scene, scenes
from tests.truth.__main__ import main as generate

MAX_CAMERA_RMS_M: Final = 3e-3  # over the balls' plane: a camera that is right
MAX_SHOT_RMS_M: Final = 10e-3  # of the samples of a shot that is usable, beside the camera's own error
SWAPPED_RADII: Final = 1.0  # from its ball, beyond which a sample is another's
EARLY_S: Final = 0.1  # by which a clip may begin before its strike
RATES: Final = (25.0, 30.0, 50.0, 60.0, 120.0)  # [1/s]
SIZES: Final = ((640, 360), (960, 540))  # [pixels]
TABLES: Final = {  # as the generator takes them: length, width [m], ball [m]
    "snooker": (3.569, 1.778, 0.0525), "pool 9 ft": (2.54, 1.27, 0.05715), "small": (1.881, 0.943, 0.0523),
}  # fmt: skip
RAIL_WIDTH_M: Final = 0.12  # beside the noses: cushion and some wood, which are in view
SHOTS: Final = 2
SECONDS: Final = 1.5


@dataclass(frozen=True)
class Recipe:
    """One film."""

    number: int
    table: str
    fps: float
    size: tuple[int, int]
    tilt: float  # of the camera [rad]
    aside: tuple[float, float]  # of the table's middle from the line of sight, in the camera's axes [m]
    lens: float  # first radial distortion
    suffix: str  # of the video: lossless or compressed
    look: Look
    picks: bool  # frames are picked from twice as many, at uneven times

    @property
    def name(self) -> str:
        """Of its files."""
        return f"film-{self.number:03d}"


def recipe(number: int) -> Recipe:
    """A film at random."""
    r = np.random.default_rng([2026, number])
    fps = float(r.choice(RATES))
    lamp = r.normal(0.0, 0.4, 2)
    look = Look(
        exposure=float(r.uniform(0.05, 0.5) / fps), noise=float(r.uniform(1, 8)), blur=float(r.uniform(0.4, 1.1)),
        uneven=float(r.uniform(0, 0.35)), shadow=float(r.uniform(0.1, 0.5)), light=(*map(float, lamp), 1.0),
        gloss=float(r.uniform(0.1, 0.6)), readout=float(r.choice([0.0, 0.5 / fps])),
        cushion_shadow=float(r.choice([0.0, r.uniform(0.005, 0.02)])), cloth_tops=bool(r.random() < 0.5),
        diamonds=float(r.choice([0.0, 0.012])), lamps=float(r.choice([0.0, r.uniform(0.2, 1.0)])),
        player=bool(r.random() < 0.3),
    )  # fmt: skip
    return Recipe(
        number, str(r.choice(list(TABLES))), fps, SIZES[int(r.integers(len(SIZES)))], float(r.uniform(0, 0.12)),
        (float(r.normal(0, 0.02)), float(r.normal(0, 0.02))), float(r.uniform(-0.12, 0.03)),
        str(r.choice([".mp4", ".mkv"])), look, bool(r.random() < 0.15),
    )  # fmt: skip


def made(one: Recipe, folder: Path) -> tuple[Camera, list[Scene], Path]:
    """The film, its camera and its shots."""
    length, width, diameter = TABLES[one.table]
    words = ["--seed", str(70_000 + one.number), "--clips", str(SHOTS), "--seconds", str(SECONDS), "--missing", "0"]
    words += ["--fps", f"{one.fps:g}", "--length", str(length), "--width", str(width), "--diameter", str(diameter)]
    with contextlib.redirect_stdout(io.StringIO()):
        if generate([str(folder / "truth"), *words]):
            raise RuntimeError(f"{one.name}: the generator refused {' '.join(words)}")
    sized, _, fps, shots = scenes(folder / "truth")
    camera = aimed(camera_over(sized, diameter, one.size, one.tilt, one.lens), one.aside, RAIL_WIDTH_M)
    video = folder / f"film{one.suffix}"
    code = cv2.VideoWriter.fourcc(*("FFV1" if one.suffix == ".mkv" else "mp4v"))
    out = cv2.VideoWriter(str(video), code, fps, one.size)
    for picture in pictures(camera, shots, fps, one.look, one.number, picks=one.picks):
        out.write(picture)
    out.release()
    write_camera(folder / "true.toml", camera)
    return camera, shots, video


def camera_error(true: Camera, found: Camera) -> float:
    """Between places on the balls' plane, over the table: rms [m]."""
    half = np.array([true.table.length, true.table.width]) / 2 - true.radius
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 13), np.linspace(-1, 1, 9)), axis=-1).reshape(-1, 2) * half
    pixels = true.outline(grid)
    seen = found.on_plane(pixels, true.radius)
    both = [seen, -seen]  # a table looks the same turned by half a circle
    return float(min(np.sqrt(np.nanmean(np.sum((one - grid) ** 2, axis=1))) for one in both))


def judged(one: Recipe, folder: Path) -> dict[str, Any]:
    """What calibrate and track made of a film."""
    length, width, diameter = TABLES[one.table]
    camera, shots, video = made(one, folder)
    row: dict[str, Any] = {"name": one.name, "table": one.table, "fps": one.fps, "size": one.size, "shots": len(shots)}
    words = ["--length", length, "--width", width, "--diameter", diameter, "--out", folder / "camera.toml"]
    row["calibrate"], row["said"] = _run(["calibrate", video, *words])
    if (folder / "camera.toml").is_file():
        row["camera_m"] = camera_error(camera, read_camera(folder / "camera.toml"))
    if row["calibrate"]:  # tracking is judged all the same
        shutil.copy(folder / "true.toml", folder / "camera.toml")
    row["track"], said = _run(["track", video, "--camera", folder / "camera.toml", "--out", folder / "clips"])
    row["said"] += said
    row |= _tracks(folder, shots, np.concatenate(moments(shots, one.fps, one.number, one.picks)), diameter)
    row["picks"] = one.picks
    return row


def _run(words: Sequence[object]) -> tuple[int, list[str]]:
    """Exit status of a verb, and what it said of trust."""
    out, error = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(error):
        status = sysid([str(word) for word in words])
    told = [line for line in out.getvalue().splitlines() if "trust" in line]
    return status, [*told, *error.getvalue().splitlines()[-1:]] if status else []


def _tracks(folder: Path, shots: Sequence[Scene], taken: Array, diameter: float) -> dict[str, Any]:
    """Shots that are usable, samples that are another ball's or none's, noise told over true; frames taken at times."""
    if not (folder / "clips" / "clips.toml").is_file():
        return {"usable": 0, "samples": 0, "swapped": 0}
    clip_set = read_clip_set(folder / "clips")
    usable = samples = swapped = 0
    names = {name for shot in shots for name in shot.track.names}
    scatter: list[Array] = []
    places: list[Array] = []  # squared errors of usable shots [m^2]
    for clip in clip_set.clips:
        begins = float(taken[clip.extra["frames"][0]])  # the clip's first sample
        shot = _shot_during(begins, shots)
        unknown = [
            len(seen.time) for name, seen in clip.balls.items() if name not in (shot.track.names if shot else names)
        ]
        samples, swapped = samples + sum(unknown), swapped + sum(unknown)
        if shot is None:
            continue
        errors = []
        for name, seen in clip.balls.items():
            if name not in shot.track.names:
                continue
            true = shot.places(name, begins + seen.time)
            away, flipped = seen.xy - true, -seen.xy - true
            errors.append(away if np.nanmedian(np.abs(away)) <= np.nanmedian(np.abs(flipped)) else flipped)
            scatter.append(smooth_errors(begins + seen.time, errors[-1], shot.impacts(name), 1 / clip_set.fps))
        if not errors:
            continue
        away = np.concatenate(errors)
        away = away[np.isfinite(away).all(axis=1)]
        far = np.linalg.norm(away, axis=1) > SWAPPED_RADII * diameter / 2
        samples, swapped = samples + len(far), swapped + int(far.sum())
        near = far.mean() < 0.05 if len(far) else False
        squares = np.sum(away[~far] ** 2, axis=1)
        if near and np.sqrt(np.mean(squares)) < MAX_SHOT_RMS_M:
            usable += 1
            places.append(squares)
    squares = np.concatenate(scatter) ** 2 if scatter else np.zeros(0)
    squares = np.minimum(squares, np.median(squares) * 25) if squares.size else squares
    noise = float(np.sqrt(np.mean(squares))) if squares.size else np.nan
    told = clip_set.sigma / noise if clip_set.sigma is not None and noise > 0 else np.nan
    return {
        "usable": min(usable, len(shots)), "samples": samples, "swapped": swapped, "noise_ratio": told,
        "error_m": float(np.sqrt(np.mean(np.concatenate(places)))) if places else np.nan,
        "told_m": clip_set.extra["videos"][0]["places_rms"],
    }  # fmt: skip


def smooth_errors(times: Array, errors: Array, impacts: Array, period: float) -> Array:
    """Third differences of errors (n, 2) in smooth motion: what is noise, and no error of the camera; (m,) [m].

    A picture exposed through an impact shows the mean of two motions. That is no noise: it is left out here, as noise
    is told of smooth motion.
    """
    known = np.isfinite(errors).all(axis=1)
    times, errors = times[known], errors[known]
    found = [np.zeros(0)]
    for k in range(len(times) - 3):
        first, last = times[k] - period / 2, times[k + 3] + period / 2
        if last - first < 5 * period and not ((impacts > first) & (impacts < last)).any():
            found.append(errors[k : k + 4].T @ [-1.0, 3.0, -3.0, 1.0] / np.sqrt(20.0))
    return np.concatenate(found)


def _shot_during(time: float, shots: Sequence[Scene]) -> Scene | None:
    """The shot during which a clip begins [s]."""
    return next((shot for shot in shots if shot.struck - EARLY_S < time < shot.ends), None)


def _one(job: tuple[int, Path]) -> dict[str, Any]:
    number, out = job
    one = recipe(number)
    file, work = out / f"{one.name}.json", out / one.name
    if file.is_file():
        found: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        return found
    shutil.rmtree(work, ignore_errors=True)
    work.mkdir(parents=True)
    row = judged(one, work)
    for video in work.glob("film.*"):
        video.unlink()
    file.write_text(json.dumps(row, default=str), encoding="utf-8")
    return row


def rows(found: Sequence[dict[str, Any]]) -> list[tuple[str, ...]]:
    """The table of figures."""
    passed = [r for r in found if r["calibrate"] == 0]
    right = [r for r in passed if r["camera_m"] <= MAX_CAMERA_RMS_M]
    shots, samples = sum(r["shots"] for r in found), sum(r["samples"] for r in found)
    ratios = np.array([r["noise_ratio"] for r in found if np.isfinite(r.get("noise_ratio", np.nan))])
    places = np.array([r["error_m"] / r["told_m"] for r in passed if np.isfinite(r.get("error_m", np.nan))])
    errors = np.array([1e3 * r["camera_m"] for r in passed])
    return [
        ("figure", "measured", "of"),
        ("cameras passed and right", str(len(right)), str(len(found))),
        ("cameras passed and wrong", str(len(passed) - len(right)), str(len(found))),
        ("error of those passed, median; worst [mm]", _two(errors, np.median, np.max), str(len(errors))),
        ("shots usable", str(sum(r["usable"] for r in found)), str(shots)),
        ("samples of another ball, or of none", str(sum(r["swapped"] for r in found)), str(samples)),
        ("noise told over true, median; worst", _two(ratios, np.median, np.max), str(len(ratios))),
        (
            "error of places over what is told, camera passed, median; worst",
            _two(places, np.median, np.max),
            str(len(places)),
        ),
        ("of it at most 1.5", str(int((places <= 1.5).sum())), str(len(places))),
        ("of it from 0.8 to 1.25", str(int(((ratios > 0.8) & (ratios < 1.25)).sum())), str(len(ratios))),
    ]


def _two(values: Array, *figures: Callable[[Array], Any]) -> str:
    return "; ".join(f"{figure(values):.2f}" for figure in figures) if values.size else "-"


def main(words: Sequence[str] | None = None) -> int:
    """Film, calibrate, track, report."""
    p = argparse.ArgumentParser(prog="python -m tests.footage.study", description="Random films, judged.")
    p.add_argument("--films", type=int, default=200, metavar="N")
    p.add_argument("--out", type=Path, default=Path("out/films"), metavar="DIR")
    p.add_argument("--workers", type=int, default=2, metavar="N")
    args = p.parse_args(words)
    args.out.mkdir(parents=True, exist_ok=True)
    found = []
    with ProcessPoolExecutor(args.workers) as pool:
        for row in pool.map(_one, [(k, args.out) for k in range(args.films)]):
            found.append(row)
            camera = f"{1e3 * row['camera_m']:.2f} mm" if row.get("camera_m") is not None else "none"
            print(
                f"{row['name']} {row['table']}, {row['fps']:g}/s: camera {camera}, status {row['calibrate']}; "
                f"{row['usable']} of {row['shots']} shots; noise {row.get('noise_ratio', float('nan')):.2f}; "
                + " | ".join(row["said"])[:160], flush=True,
            )  # fmt: skip
    print(table(rows(found)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
