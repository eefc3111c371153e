"""The same clips for `mujoco.sysid` and for `sysid discover`: what each finds, how sure it is of it, and what it says.

`python -m tests.bench.toolbox CLIPS` takes clips of one ball each, as `python -m tests.truth` makes them. MuJoCo's
toolbox gets the MJCF that `python -m models.mjcf.export` writes, its residual at the tracked samples over the noise of
the tracker, and parameters scaled to about 1. Its starts are what its user can measure, a parabola through the first
frames and the spin of the commanded stroke, or parameters of their own by its rollout hook. "gravity by hand" is a
user who suspects a tilt already. Of several settings of its optimisers the one with the least loss counts.
"""

from __future__ import annotations

import argparse
import contextlib
import importlib
import io
import json
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from models.commands.console import table
from models.mjcf.export import export
from models.mjcf.native import Native, solref
from models.model_file import Model
from models.shot import GRAVITY, Array
from sysid.cli import main as run_cli
from sysid.clips import Clip, ClipSet, read_clip_set
from sysid.clips.tracker.noise import position_noise
from sysid.estimation.split import subset, training_clips

STEP, FINE = 5e-4, 2e-4  # of MuJoCo's simulation [s]; with cushions twice that of the MJCF, ten in an impact
FIRST = (0.4, 0.3, 0.2, 0.15, 0.1, 0.07)  # windows for the parabola; the longest in which it holds counts [s]
HOLDS = 1.1  # residual of a parabola that holds, over the noise
ITERATIONS, FEW = 20, 8  # of the optimisers; where starts are fitted too
T95 = 1.96  # standard deviations in half of a 95 % interval
SETTINGS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("mujoco", {"xtol": 1e-4}),
    ("scipy_parallel_fd", {"xtol": 1e-4, "diff_step": 1e-2, "x_scale": "jac"}),
)
WITH_STARTS = (SETTINGS[1],)
UNITS = np.array([0.01, 0.01, 0.1, 0.1, 10.0, 10.0])  # of a start's corrections: x, y [m], vx, vy [m/s], wx, wy [rad/s]
REACH = 10.0  # units a start may be corrected by
SLOPE = 1e-3  # unit of the gravity's direction [rad]
CLOTH, CUSHION = ("slide", "roll"), ("cushion_restitution", "cushion_friction")
NEAR = 0.02  # between ball and nose, from which a cushion may be touched [m]


@dataclass(frozen=True)
class Found:
    """What a tool found."""

    tool: str
    took: float  # [s]
    rms: float  # of the fitted clips, per axis, over the noise
    held: float  # of the clips held out
    values: dict[str, tuple[float, float]]  # with half of the 95 % interval
    told: tuple[str, ...]  # its own words


def loaded() -> Any:
    """MuJoCo's toolbox; without its extra packages the import leaves it empty, which is a ModuleNotFoundError here."""
    toolbox: Any = importlib.import_module("mujoco.sysid")
    if not hasattr(toolbox, "optimize"):
        importlib.import_module("mujoco.sysid._src.optimize")
        importlib.import_module("mujoco.sysid._src.parameter")
        importlib.import_module("mujoco.sysid.report.defaults")
        raise ModuleNotFoundError("mujoco.sysid is empty")
    return toolbox


def one_ball(clip_set: ClipSet) -> ClipSet:
    """The clips with one ball."""
    return subset(clip_set, [k for k, clip in enumerate(clip_set.clips) if len(clip.balls) == 1])


def measured_start(clip: Clip, radius: float, sigma: float) -> Array:
    """x, y, vx, vy, wx, wy, wz at the first sample, as a user measures it: (7,)."""
    seen = clip.balls[clip.struck]
    t = seen.time - seen.time[0]
    c = np.zeros((3, 2))
    for window in FIRST:
        near = t <= window
        c = np.polynomial.polynomial.polyfit(t[near], seen.xy[near], 2)
        off = np.polynomial.polynomial.polyval(t[near], c).T - seen.xy[near]
        if np.sum(off**2) <= (HOLDS * sigma) ** 2 * (2 * near.sum() - 6):
            break
    spin = np.zeros(3)
    if clip.cue is not None:
        way = np.array([np.cos(clip.cue.azimuth), np.sin(clip.cue.azimuth)])
        rate = 2.5 * float(np.hypot(*c[1])) / radius**2
        spin = rate * np.array([-clip.cue.height * way[1], clip.cue.height * way[0], clip.cue.side])
    return np.concatenate([c[0], c[1], spin])


def touching(clip_set: ClipSet) -> bool:
    """Whether a ball comes near a cushion."""
    reach = np.asarray(clip_set.table.centre_limits(clip_set.ball)) - NEAR
    return any(bool(np.any(np.abs(seen.xy) > reach)) for clip in clip_set.clips for seen in clip.balls.values())


class Peer:
    """MuJoCo's toolbox on the training clips of a set."""

    def __init__(self, toolbox: Any, clip_set: ClipSet, folder: Path) -> None:
        """Export the table and measure the starts."""
        self.toolbox, self.clip_set = toolbox, clip_set
        self.sigma = position_noise(clip_set)
        self.native = Native()
        self.path = folder / "table.xml"
        export(Model(clip_set.table, clip_set.ball), {"ball": np.zeros(2)}, self.path, bare=True)
        self.training = training_clips(clip_set)
        self.held = [k for k in range(len(clip_set.clips)) if k not in self.training]
        self.starts = [measured_start(clip, clip_set.ball.radius, self.sigma) for clip in clip_set.clips]
        cushions = touching(clip_set)
        self.names = CLOTH + (CUSHION if cushions else ())
        self.step = FINE if cushions else STEP

    def spec(self) -> mujoco.MjSpec:
        """The exported world, with a sensor for the ball's place."""
        spec = mujoco.MjSpec.from_file(str(self.path))
        spec.option.timestep = self.step
        spec.add_sensor(
            name="place", type=mujoco.mjtSensor.mjSENS_FRAMEPOS, objtype=mujoco.mjtObj.mjOBJ_BODY, objname="ball"
        )
        return spec

    def state(self, model: mujoco.MjModel, start: Array) -> Array:
        """MuJoCo's state of a start."""
        qpos = np.array([*start[:2], self.clip_set.ball.radius, 1.0, 0.0, 0.0, 0.0])
        qvel = np.array([*start[2:4], 0.0, *start[4:]])
        return np.asarray(self.toolbox.create_initial_state(model, qpos, qvel))

    def set(self, spec: mujoco.MjSpec, name: str, value: float) -> None:
        """Write a constant into the contacts of its class."""
        for pair in spec.pairs:
            bed = "bed" in (pair.geomname1, pair.geomname2)
            if bed and name == "slide":
                pair.friction[:2] = value
            elif bed and name == "roll":
                pair.friction[3:] = 1.4 * value * self.clip_set.ball.radius
            elif not bed and name == "cushion_friction":
                pair.friction[:2] = value
            elif not bed and name == "cushion_restitution":
                pair.solref = solref(value)

    def modifier(self, name: str, usual: float) -> Callable[[mujoco.MjSpec, Any], None]:
        """What applies a constant's parameter."""
        return lambda spec, param: self.set(spec, name, usual * float(param.value[0]))

    def constants(self, tilted: bool) -> Any:
        """The constants in units of what the MJCF has, and with `tilted` the direction of gravity."""
        params = self.toolbox.ParameterDict()
        for name in self.names:
            usual = float(getattr(self.native, name))
            most = 1.1 if name == "cushion_restitution" else 2.0
            params.add(self.toolbox.Parameter(name, 1.0, 0.3, most, modifier=self.modifier(name, usual)))
        if tilted:
            for axis, name in enumerate(("tilt_x", "tilt_y")):
                params.add(self.toolbox.Parameter(name, 0.0, -10.0, 10.0, modifier=leaning(axis)))
        return params

    def add_starts(self, params: Any, rows: Sequence[int]) -> None:
        """Corrections of the measured starts, one parameter a clip."""
        for k in rows:
            params.add(self.toolbox.Parameter(f"start_{k}", np.zeros(6), np.full(6, -REACH), np.full(6, REACH)))

    def residual(self, rows: Sequence[int], spec: mujoco.MjSpec, own: bool) -> Any:
        """Its residual function for some clips; `own` starts are taken from the parameters."""
        model = spec.compile()
        series, sequences, known = self.toolbox.TimeSeries, [], {}
        place = {"place": (self.toolbox.SignalType.MjSensor, np.arange(3))}
        for k in rows:
            seen = next(iter(self.clip_set.clips[k].balls.values()))
            t = seen.time - seen.time[0]
            grid = np.arange(int(np.ceil(t[-1] / self.step)) + 2) * self.step
            xyz = np.column_stack([seen.xy, np.full(len(t), self.clip_set.ball.radius)])
            state = self.state(model, self.starts[k])
            known[state.tobytes()] = k
            sequences.append(
                self.toolbox.ModelSequences(
                    f"clip_{k}", spec, "seen", state, series(grid, np.zeros((len(grid), 0))), series(t, xyz, place)
                )
            )

        def at_samples(
            params: Any, predicted: Any, seen: Any, model: mujoco.MjModel, every: bool, *, state: Array, **_: Any
        ) -> tuple[Array, Any, Any]:
            """Differences at the tracked samples over the noise; the first is the start itself."""
            xyz = np.column_stack([np.interp(seen.times[1:], state[:, 0], state[:, k]) for k in (1, 2, 3)])
            r = (xyz[:, :2] - seen.data[1:, :2]) / self.sigma
            return r.ravel(), series(seen.times[1:], xyz, place), series(seen.times[1:], seen.data[1:], place)

        def rollout(*, models: Any, initial_states: Any, param_dicts: Any, **rest: Any) -> Any:
            """Each shot from its own start; columns that only another shot's start tells apart are rolled once."""
            k = known[np.asarray(initial_states[0]).tobytes()]
            keys: list[tuple[bytes, ...]] = []
            unique: dict[tuple[bytes, ...], tuple[int, Array]] = {}
            for i, params in enumerate(param_dicts):
                own_start = params[f"start_{k}"].value
                shared = [v.value.tobytes() for name, v in params.items() if not name.startswith("start_")]
                keys.append((own_start.tobytes(), *shared))
                unique.setdefault(keys[-1], (i, own_start))
            states = []
            for i, own_start in unique.values():
                start = self.starts[k].copy()
                start[:6] += UNITS * own_start
                states.append(self.state(models[i], start))
            rest["control_signal"] = list(rest["control_signal"])[: len(states)]
            found = self.toolbox.sysid_rollout(
                models=[models[i] for i, _ in unique.values()], initial_states=states, **rest
            )
            at = {key: row for row, key in enumerate(unique)}
            return [found[at[key]] for key in keys]

        return self.toolbox.build_residual_fn(
            models_sequences=sequences, modify_residual=at_samples, custom_rollout=rollout if own else None,
            resample_true=False,
        )  # fmt: skip

    def optimum(self, params: Any, residual: Any, settings: Sequence[tuple[str, dict[str, Any]]]) -> tuple[Any, Any]:
        """The best of several settings."""
        best: tuple[float, Any, Any] | None = None
        iterations = FEW if settings is WITH_STARTS else ITERATIONS
        for name, options in settings:
            began = time.perf_counter()
            with contextlib.redirect_stdout(io.StringIO()):
                found, result = self.toolbox.optimize(params, residual, optimizer=name, max_iters=iterations, **options)
            loss = rms(residual, found)
            took = time.perf_counter() - began
            print(f"  {name} {options or ''}: {loss:.3f} of the noise, {took:.0f} s", file=sys.stderr, flush=True)
            if best is None or loss < best[0]:
                best = (loss, found, result)
        assert best is not None
        return best[1], best[2]

    def run(self, own: bool, tilted: bool) -> Found:
        """Fit, try on the clips held out, and read what it says."""
        began = time.perf_counter()
        spec, params = self.spec(), self.constants(tilted)
        if own:
            self.add_starts(params, self.training)
        residual = self.residual(self.training, spec, own)
        found, result = self.optimum(params, residual, WITH_STARTS if own else SETTINGS)
        left, _, _ = residual(found.as_vector(), found)
        _, half = self.toolbox.calculate_intervals(left, np.asarray(result.jac))
        insights: Any = importlib.import_module("mujoco.sysid.report.sections.insights")
        told = insights.AutomatedInsights("insights", found).get_context()["insights"]
        took = time.perf_counter() - began
        held = self.held_out(found, own, tilted)
        scale = {name: float(getattr(self.native, name)) for name in self.names} | {"tilt_x": SLOPE, "tilt_y": SLOPE}
        names = found.get_non_frozen_parameter_names()
        values = {
            n: (scale[n] * float(v), scale[n] * float(h))
            for n, v, h in zip(names, found.as_vector(), half, strict=True)
            if n in scale
        }
        tool = "mujoco.sysid" + (", starts fitted" if own else "") + (", gravity by hand" if tilted else "")
        return Found(
            tool, took, rms(residual, found), held, values, tuple(f"{i['title']}: {i['message']}" for i in told)
        )

    def held_out(self, found: Any, own: bool, tilted: bool) -> float:
        """Error on the clips held out, with the constants as found; `own` starts are fitted to them."""
        if not self.held:
            return float("nan")
        if not own:
            return rms(self.residual(self.held, self.spec(), False), found)
        # A frozen parameter is not applied, so the constants go into the world itself.
        spec = self.spec()
        for param in found.values():
            param.apply_modifier(spec)
        params = self.toolbox.ParameterDict()
        self.add_starts(params, self.held)
        residual = self.residual(self.held, spec, True)
        return rms(residual, self.optimum(params, residual, WITH_STARTS)[0])


def leaning(axis: int) -> Callable[[mujoco.MjSpec, Any], None]:
    """What leans gravity as a table that falls by a slope along an axis does."""

    def lean(spec: mujoco.MjSpec, param: Any) -> None:
        gravity = np.array(spec.option.gravity)
        gravity[axis] = GRAVITY * SLOPE * float(param.value[0])
        spec.option.gravity = gravity

    return lean


def rms(residual: Any, params: Any) -> float:
    """Per axis, over the noise."""
    left, _, _ = residual(params.as_vector(), params)
    return float(np.sqrt(np.mean(np.concatenate(left) ** 2)))


def ours(folder: Path, out: Path) -> Found:
    """`sysid discover`."""
    told = io.StringIO()
    began = time.perf_counter()
    with contextlib.redirect_stdout(told), contextlib.redirect_stderr(io.StringIO()):
        run_cli(["discover", str(folder), "--out", str(out)])
    took = time.perf_counter() - began
    result = json.loads((out / "result.json").read_text())
    noise, last = result["noise_floor_m"], result["ladder"][-1]
    short = {"slope_x": "tilt_x", "slope_y": "tilt_y"}
    values = {}
    for name, row in result["parameters"].items():
        effect, _, key = name.rpartition(".")
        key = "cushion_" + key if effect == "cushion_impact" else short.get(key, key)
        values[key] = (row["value"], float("nan") if row["sd"] is None else T95 * row["sd"])
    words = told.getvalue().splitlines()
    first = next((k for k, line in enumerate(words) if line.startswith("verdict")), 0)
    stop = next((k for k, line in enumerate(words) if k > first and not line.strip()), first + 1)
    return Found(
        "sysid discover", took, last["rms_m"] / noise, last["held_out_rms_m"] / noise, values, tuple(words[first:stop])
    )


def shown(found: Found, name: str, unit: float, digits: int) -> str:
    """A value with its 95 % interval."""
    if name not in found.values:
        return ""
    value, half = found.values[name]
    return f"{value / unit:.{digits}f} +- {half / unit:.{digits}f}"


def rows(found: Sequence[Found], truth: dict[str, float]) -> list[tuple[str, ...]]:
    """The tools, one a line, under the truth where it is known."""
    columns = (
        ("roll", "mur", 1.0, 6), ("slide", "mus", 1.0, 4), ("tilt_x", "tilt_x", 1e-3, 4), ("tilt_y", "tilt_y", 1e-3, 4),
    )  # fmt: skip
    head = ("roll", "slide", "tilt x mrad", "tilt y mrad")
    lines: list[tuple[str, ...]] = [("tool", "s", "fitted/noise", "held out/noise", *head)]
    for f in found:
        cells = [shown(f, name, unit, digits) for name, _, unit, digits in columns]
        lines.append((f.tool, f"{f.took:.0f}", f"{f.rms:.2f}", f"{f.held:.2f}", *cells))
    if truth:
        known = [f"{truth.get(key, 0.0) / unit:.{digits}f}" for _, key, unit, digits in columns]
        lines.append(("truth", "", "1.00", "1.00", *known))
    return lines


def main(argv: Sequence[str] | None = None) -> int:
    """Compare MuJoCo's toolbox with `sysid discover` on the same clips."""
    parser = argparse.ArgumentParser(prog="python -m tests.bench.toolbox", description=main.__doc__)
    parser.add_argument("clips", type=Path, metavar="CLIPS", help="clips of one ball; CLIPS.truth.json, if there")
    parser.add_argument("--quick", action="store_true", help="without the fits of the starts")
    given = parser.parse_args(argv)
    beside = given.clips.parent / f"{given.clips.name}.truth.json"
    truth = json.loads(beside.read_text())["parameters"] if beside.is_file() else {}
    clip_set = one_ball(read_clip_set(given.clips))
    with tempfile.TemporaryDirectory() as scratch:
        found = [ours(given.clips, Path(scratch) / "out")]
        why = ""
        try:
            peer = Peer(loaded(), clip_set, Path(scratch))
        except ModuleNotFoundError as error:
            why = f"mujoco.sysid is not compared: {error}; pip install -r tests/bench/toolbox.txt"
        else:
            for own in (False,) if given.quick else (False, True):
                for tilted in (False, True):
                    print(f"starts {'fitted' if own else 'measured'}, tilt {tilted}", file=sys.stderr, flush=True)
                    found.append(peer.run(own, tilted))
    print(f"{len(clip_set.clips)} clips on {os.cpu_count()} cores; constants with their 95 % intervals")
    print(table(rows(found, truth)))
    for f in found:
        print(f"\n{f.tool} says:\n  " + "\n  ".join(f.told))
    if why:
        print(f"\n{why}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
