"""A folder of tracked clips, `billiard-clips/1`, and beside it the truth that they were made with.

Seen positions carry Gaussian noise and a fraction of a ball's frames is missing; the cue entries are what was
commanded, which the real stroke missed a little. Numbers are rounded when written, so equal seeds give equal bytes.
"""

from __future__ import annotations

import json
import os
import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
import tomli_w

from tests.truth.camera import Camera, displaced, image, stamps
from tests.truth.cloth import Constants
from tests.truth.effects import HIDDEN
from tests.truth.physics import STEP, Cue, Table
from tests.truth.shots import Shot, clip_constants
from tests.truth.soil import Soil, gaps, hanging, measured_wrong, swapped

SPEED_SPREAD = 0.02  # of the stroke about its command, one standard deviation [1]
AZIMUTH_SPREAD = float(np.radians(0.3))  # [rad]
OFFSET_SPREAD = 0.5e-3  # of the contact point [m]
OFF = Constants()
CLEAN = Soil()


class Refused(Exception):
    """The folder cannot be written."""


def _commanded(cue: Cue, rng: np.random.Generator) -> dict[str, float]:
    """A command that the true stroke could have come from."""
    dv, da, ds, dh = rng.normal(size=4)
    return {
        "speed": round(cue.speed / (1 + SPEED_SPREAD * dv), 4),
        "azimuth": round(cue.azimuth + AZIMUTH_SPREAD * da, 5),
        "side": round(cue.side + OFFSET_SPREAD * ds, 6),
        "height": round(cue.height + OFFSET_SPREAD * dh, 6),
        "elevation": round(cue.elevation, 4),
    }


def _rows(shot: Shot, c: Constants, camera: Camera, soil: Soil, seed: int, clip: int, rng: np.random.Generator) -> str:
    """The clip's CSV. A ball's first sample is always there; the angle only where the mark is meant to be tracked."""
    motion = shot.motion
    n, balls = motion.theta.shape
    stamp = stamps(motion.times, c)
    xy = image(motion.xy, motion.times, c, clip) + camera.sigma * rng.normal(size=motion.xy.shape)
    theta = motion.theta + camera.sigma_theta * rng.normal(size=motion.theta.shape)
    kept = rng.random((n, balls)) >= camera.missing
    kept[0] = True
    if camera.outliers > 0.0:
        # From a stream of its own: the other samples are those of the set without.
        xy[1:] = displaced(xy[1:], camera.outliers, np.random.default_rng([seed, clip, 3]))
    if soil != CLEAN:
        own = np.random.default_rng([seed, clip, 4])
        xy = swapped(xy + hanging(motion.times, motion.xy.shape, soil, own), soil, own)
        kept &= gaps(motion.times, balls, soil, own)
        stamp = stamp + own.uniform(*soil.origin)
    lines = ["t,ball,x,y,theta"]
    for k in range(n):
        for b, name in enumerate(motion.names):
            if kept[k, b] and np.isfinite(xy[k, b, 0]):
                mark = f"{theta[k, b]:.4f}" if shot.scene.cue is None or (camera.marked and b == 0) else ""
                lines.append(f"{stamp[k]:.6f},{name},{xy[k, b, 0]:.6f},{xy[k, b, 1]:.6f},{mark}")
    return "\n".join(lines) + "\n"


def _parameters(c: Constants) -> dict[str, float]:
    """The constants by their short names; those of an effect only where it is on."""
    hidden = {field for fields in HIDDEN.values() for field in fields}
    shown = {field for name in effects_on(c) for field in HIDDEN[name]}
    short = {"radius": "R", "mass": "m"}
    return {short.get(k, k): v for k, v in c._asdict().items() if k not in hidden or k in shown}


def effects_on(c: Constants) -> list[str]:
    """Names of the hidden effects that are on."""
    return [name for name, fields in HIDDEN.items() if any(getattr(c, f) != getattr(OFF, f) for f in fields)]


def _truth(shots: Sequence[Shot], c: Constants, camera: Camera, seed: int, soil: Soil) -> str:
    """The truth beside the folder, as JSON: effects, constants, and how every clip really began and went."""
    own = [clip_constants(c, seed, k, len(shots))._asdict() for k in range(1, len(shots) + 1)]
    clips = [
        {
            "file": f"clips/{k:04d}.csv",
            "kind": shot.kind,
            "cue": None if shot.scene.cue is None else asdict(shot.scene.cue),
            "balls": {name: asdict(ball) for name, ball in shot.scene.balls.items()},
            "events": [{**asdict(event), "time": round(event.time, 9)} for event in shot.motion.events],
            **{name: value for name, value in own[k - 1].items() if value != getattr(c, name)},
        }
        for k, shot in enumerate(shots, 1)
    ]
    truth = {
        "format": "billiard-truth/1",
        "seed": seed,
        "effects": effects_on(c),
        "sigma_m": camera.sigma,
        "sigma_theta_rad": camera.sigma_theta,
        "missing": camera.missing,
        "step_s": STEP,
        "parameters": _parameters(c),
        **({"outliers": camera.outliers} if camera.outliers > 0.0 else {}),
        **({"soil": asdict(soil)} if soil != CLEAN else {}),
        "clips": clips,
    }
    return json.dumps(truth, indent=1) + "\n"


def _check_target(out: Path, force: bool) -> None:
    if out.is_symlink() or (out.exists() and not out.is_dir()):
        raise Refused(f"{out}: exists and is no folder; name another")
    if out.is_dir() and any(out.iterdir()):
        if not force:
            raise Refused(f"{out}: is not empty; name another folder, or replace the clip set in it with --force")
        if not (out / "clips.toml").is_file():
            raise Refused(f"{out}: holds no clips.toml, so it is no clip set to replace; name another folder")


def write(
    out: Path,
    shots: Sequence[Shot],
    table: Table,
    c: Constants,
    camera: Camera,
    seed: int,
    with_cue: bool = True,
    force: bool = False,
    soil: Soil = CLEAN,
) -> Path:
    """Write the clip set to the folder out, whole or not at all, and its truth beside it; the truth's path."""
    _check_target(out, force)
    out.parent.mkdir(parents=True, exist_ok=True)
    truth = out.with_name(out.name + ".truth.json")
    work = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
    try:
        folder = work / "set"
        (folder / "clips").mkdir(parents=True)
        entries = []
        for k, shot in enumerate(shots, 1):
            # Each clip has its own stream, so that one more clip changes none of the others.
            rng = np.random.default_rng([seed, k, 1])
            entry: dict[str, object] = {"file": f"clips/{k:04d}.csv", "struck": "cue", "note": shot.kind}
            command = None if shot.scene.cue is None else _commanded(shot.scene.cue, rng)
            if with_cue and command is not None:
                entry["cue"] = command
            entries.append(entry)
            (folder / f"clips/{k:04d}.csv").write_text(_rows(shot, c, camera, soil, seed, k, rng), encoding="utf-8")
        wrong = np.random.default_rng([seed, 5])
        length, width = (measured_wrong(size, soil.table, wrong) for size in (table.length, table.width))
        diameter = measured_wrong(2 * c.radius, soil.ball, wrong)
        if soil == CLEAN:
            length, width, diameter = table.length, table.width, round(2 * c.radius, 9)
        head = {
            "format": "billiard-clips/1",
            "table": {"length": length, "width": width, "pockets": table.pockets},
            "ball": {"diameter": diameter, "mass": c.mass},
            "camera": {"fps": camera.fps, **({"sigma": camera.sigma} if camera.told else {})},
            "clip": entries,
        }
        (folder / "clips.toml").write_text(tomli_w.dumps(head), encoding="utf-8")
        (work / "truth").write_text(_truth(shots, c, camera, seed, soil), encoding="utf-8")
        if out.is_dir():
            os.replace(out, work / "old")
        os.replace(folder, out)
        os.replace(work / "truth", truth)
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return truth
