"""The Python interface `models.simulate`, for whole shots or for one stroke of the cue ball.

In: a `Model`, or a result with one (`.model`), and shots, or a stroke. Out: `SimulatedShot`s: tracks that print, plot
and convert to data frames.

A stroke gives the ball speed V along its azimuth and the spin 5 c V / (2 R^2) of its contact offset c (Robotic
Billiards 2015, equations 1a and 1b); a cue inclined by E adds its sine times the sidespin along the azimuth.
Squirt and hop are effects of the model.
"""

from __future__ import annotations

import dataclasses
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, overload

import numpy as np

from models.analytic.cueing import spin_estimate
from models.compiled import note_compiling, set_ready
from models.errors import BadInput
from models.files.faults import closest, listed, shown
from models.model_file import Model
from models.report.sheet import Picture, Presented, Sheet
from models.shot import MAX_SPEED_M_S, Array, Ball, Shot, Track, largest_overlap
from models.simulation.simulate import simulate as simulate_shots

MAX_STROKE_S = 40.0  # longest duration of a stroke; a ball at 10 m/s rolls some 25 s
STROKE_PERIOD_S = 1 / 120  # sampling interval of a stroke
CUE_BALL_NAMES = ("cue", "white")
COMPILED_MARK = "played"  # mark of compiled code for playing shots
REST_MOTION_M = 1e-6  # a ball within this distance of its last place rests
PLACE_ROUNDING_M = 1e-6  # by which balls that touch may overlap, their places being written with six decimals
SPIN_NAMES = ("wx", "wy", "wz")


class HasModel(Protocol):
    """A result with a model, as of `sysid.fit` or `sysid.discover`."""

    @property
    def model(self) -> Model:
        """The model."""


def model_of(given: Model | HasModel) -> Model:
    """The model itself, or that of a result; BadInput for what is neither."""
    own = given if isinstance(given, Model) else getattr(given, "model", None)
    if not isinstance(own, Model):
        raise BadInput(f"model is {shown(given)}: give a model, such as models.load_model(PATH), or a result with one")
    return own


@dataclass(frozen=True, repr=False, eq=False)
class SimulatedShot(Presented, Track):
    """A track together with its model."""

    model: Model = dataclasses.field(kw_only=True)

    def sheet(self) -> Sheet:
        """A table with the path of every ball; the data frame has every sample."""
        met = Counter(name for event in self.events for name in event.balls)
        fell = {event.balls[0] for event in self.events if event.kind == "pocket"}
        rows = []
        for k, name in enumerate(self.names):
            way = self.position[np.isfinite(self.position[:, k]).all(axis=1), k]
            length = float(np.hypot(*np.diff(way, axis=0).T).sum())
            speed = float(np.hypot(*self.velocity[0, k]))
            x, y = way[-1]
            end = "in a pocket" if name in fell else f"{x:+.3f}, {y:+.3f}"
            rows.append((name, f"{speed:.2f}", f"{length:.3f}", str(met[name]), end))
        heads = ("ball", "initial speed [m/s]", "path [m]", "impacts", "ends at x, y [m]")
        return Sheet(self._samples(), heads, tuple(rows), (f"{self.times[-1] - self.times[0]:.2f} s of a shot",))

    def _samples(self) -> dict[str, Any]:
        """A data frame of every sample, ball after ball."""
        n = len(self.times)
        found: dict[str, Any] = {
            "ball": np.repeat(np.array(self.names), n),
            "time": np.tile(self.times, len(self.names)),
        }
        values = np.concatenate([self.position, self.velocity, self.spin], axis=2)
        for j, name in enumerate(("x", "y", "vx", "vy", *SPIN_NAMES)):
            found[name] = values[:, :, j].T.ravel()
        return found

    def plot(self) -> Picture:
        """Draw the table from above with the balls' paths, and rings at their ends."""
        from models.report.axes import circle, draw_table, rgb
        from models.report.figure import FIGURE_WIDTH_IN
        from models.table.palette import ball_colour

        own = self.model.as_played()

        def draw(fig: Any) -> None:
            ax = fig.subplots()
            draw_table(ax, own.table)
            for k, name in enumerate(self.names):
                way = self.position[np.isfinite(self.position[:, k]).all(axis=1), k]
                colour = rgb(ball_colour(name))
                ax.plot(*way.T, color=colour, lw=1.6, zorder=5, label=name)
                ax.add_patch(circle(way[0], own.ball.radius, fc=colour, ec="black", lw=0.6, zorder=6))
                ax.add_patch(circle(way[-1], own.ball.radius, fc="none", ec=colour, lw=1.4, zorder=7))
            ax.set_title("Filled: where the balls start; rings: where they end")

        return Picture("played shot", FIGURE_WIDTH_IN * (own.table.width + 0.4) / (own.table.length + 0.3), draw)


def stroke_shot(
    model: Model,
    speed: float,
    azimuth: float = 0.0,
    side: float = 0.0,
    height: float = 0.0,
    elevation: float = 0.0,
    balls: Mapping[str, tuple[float, float]] | None = None,
    struck: str | None = None,
) -> Shot:
    """The shot of one stroke.

    Args:
        model: its table and ball.
        speed: of the ball as it leaves the cue [m/s].
        azimuth: of its direction, counter-clockwise from +x [rad].
        side: of the contact point, to the right as the player sees it [m].
        height: of the contact point, above the centre as seen along the cue [m].
        elevation: of the cue [rad]; a ball struck off its middle then swerves.
        balls: positions by name [m]; by default a single cue ball in the middle of the -x half.
        struck: the ball that the cue strikes; by default the one called cue or white, or the only one.

    Raises:
        BadInput: names what cannot be played.
    """
    table, ball = model.table, model.ball
    balls = balls or {"cue": (-table.length / 4, 0.0)}
    first = _struck_of(tuple(balls), struck)
    _check_stroke(speed, azimuth, side, height, elevation, ball)
    order = (first, *(name for name in balls if name != first))
    places = _checked_places(order, balls, model)
    n = len(order)
    velocity, spin = np.zeros((n, 2)), np.zeros((n, 3))
    cos, sin = math.cos(azimuth), math.sin(azimuth)
    forward, turned = spin_estimate(height, speed, ball), spin_estimate(side, speed, ball)
    along = turned * math.sin(elevation)
    velocity[0] = speed * cos, speed * sin
    spin[0] = along * cos - forward * sin, along * sin + forward * cos, turned
    times = np.arange(0.0, MAX_STROKE_S, STROKE_PERIOD_S)
    return Shot(order, places, velocity, spin, times)


def _checked_places(names: Sequence[str], balls: Mapping[str, tuple[float, float]], model: Model) -> Array:
    """Places (n, 2) [m]; BadInput for a ball that is not on the table, or lies in another."""
    places = np.zeros((len(names), 2))
    limits = model.table.centre_limits(model.ball)
    for k, name in enumerate(names):
        place = np.asarray(balls[name], float)
        if place.shape != (2,) or not np.isfinite(place).all():
            raise BadInput(f"ball {name!r} at {balls[name]}: give x, y from the table's centre [m]")
        places[k] = place
        if (np.abs(place) > limits + PLACE_ROUNDING_M).any():
            raise BadInput(
                f"ball {name!r} at {place[0]:g}, {place[1]:g} m is not on the table: give x within "
                f"+-{limits[0]:.3f} m and y within +-{limits[1]:.3f} m of its centre"
            )
    depth, i, j = largest_overlap(places, model.ball)
    if depth > PLACE_ROUNDING_M:
        raise BadInput(
            f"balls {names[i]!r} and {names[j]!r} overlap: place them {model.ball.diameter:g} m apart or more"
        )
    return places


def _struck_of(names: tuple[str, ...], struck: str | None) -> str:
    """The ball to be struck, among those on the table."""
    if struck is not None:
        if struck not in names:
            meant = closest(struck, names)
            remedy = f"did you mean {meant!r}?" if meant else f"there are {listed(names)}"
            raise BadInput(f"struck = {struck!r} is not among the balls: {remedy}")
        return struck
    known = [name for name in CUE_BALL_NAMES if name in names]
    if not known and len(names) > 1:
        raise BadInput(
            f"none of the balls {listed(names)} is called cue or white: name the struck one, as in struck={names[0]!r}"
        )
    if not known:
        raise BadInput(
            f"balls has only {names[0]!r}, which is not a cue ball: add the cue ball, such as "
            f'"cue": (-0.5, 0.0), or strike that ball itself, struck={names[0]!r}'
        )
    return known[0]


def _check_stroke(speed: float, azimuth: float, side: float, height: float, elevation: float, ball: Ball) -> None:
    """Raise BadInput for numbers that no cue can give."""
    for name, value in (("azimuth", azimuth), ("side", side), ("height", height)):
        if not math.isfinite(value):
            raise BadInput(f"{name} is {value}: give a finite number")
    if not 0.0 <= speed <= MAX_SPEED_M_S:
        raise BadInput(f"speed is {speed:g} m/s: give 0 to {MAX_SPEED_M_S:g}; a hard break has 13")
    if not 0.0 <= elevation < math.pi / 2:
        raise BadInput(f"elevation is {elevation:g} rad: give 0 for a level cue, to less than {math.pi / 2:.4g}")
    if math.hypot(side, height) > ball.radius:
        raise BadInput(
            f"side, height: {math.hypot(side, height):g} m off centre misses the ball (radius {ball.radius:g} m): "
            "give them in m"
        )


def _check_values(model: Model) -> None:
    """Raise BadInput for a constant outside its bounds."""
    for name, value in model.parameters().items():
        meta = model.meta(name)
        low, high = meta["bounds"]
        values = np.atleast_1d(np.asarray(value, float))
        wrong = values[~(((values >= low) & (values <= high)) | (values == meta["off"]))]
        if len(wrong):
            unit = "" if meta["unit"] == "1" else f" {meta['unit']}"
            raise BadInput(f"{name} is {wrong[0]:g}{unit}: give {low:g} to {high:g}")


def _check_speeds(shots: Sequence[Shot]) -> None:
    """Raise BadInput for a ball that is faster than possible."""
    for k, shot in enumerate(shots):
        speeds = np.hypot(*np.asarray(shot.velocity, float).T) if np.ndim(shot.velocity) == 2 else np.zeros(0)
        if speeds.size and float(np.nanmax(speeds)) > MAX_SPEED_M_S:
            raise BadInput(
                f"shot {k}: a ball has {float(np.nanmax(speeds)):g} m/s: give {MAX_SPEED_M_S:g} at most, in m/s"
            )


@overload
def simulate(model: Model | HasModel, shots: Sequence[Shot], **options: Any) -> list[SimulatedShot]: ...


@overload
def simulate(model: Model | HasModel, shots: None = None, **stroke: Any) -> SimulatedShot: ...


def simulate(
    model: Model | HasModel, shots: Sequence[Shot] | None = None, **options: Any
) -> SimulatedShot | list[SimulatedShot]:
    """Play shots, or one stroke until all balls rest.

    Args:
        model: a model, or a result with one.
        shots: shots to play, with the options of `models.simulation.simulate.simulate`; a track is returned for each.
        options: without shots those of a stroke, see `stroke_shot`: speed [m/s], azimuth [rad], side and height of the
        contact point [m], elevation of the cue [rad], balls by name [m], struck. A single track is returned.

    Raises:
        BadInput: a constant outside its bounds, an impossible speed, a missing ball to strike, balls that overlap or
        are not on the table.
    """
    own = model_of(model)
    _check_values(own)
    wanted = [stroke_shot(own, **options)] if shots is None else shots
    _check_speeds(wanted)
    note_compiling(COMPILED_MARK)
    played = simulate_shots(own, wanted) if shots is None else simulate_shots(own, wanted, **options)
    set_ready(COMPILED_MARK)
    found = [SimulatedShot(**vars(track), model=own) for track in played]
    return until_rest(found[0]) if shots is None else found


def until_rest(played: SimulatedShot) -> SimulatedShot:
    """The track until all balls rest."""
    away = np.nan_to_num(np.abs(played.position - _last_places(played.position)).max(axis=2)).max(axis=1)
    gone = np.isfinite(played.position[..., 0]).sum(axis=1)  # a ball that will fall is still moving
    moving = np.flatnonzero((away > REST_MOTION_M) | (gone > gone[-1]))
    end = min(int(moving[-1]) + 2, len(played.times)) if moving.size else 1
    cut = {name: getattr(played, name)[:end] for name in ("times", "position", "velocity", "spin", "theta")}
    return dataclasses.replace(played, **cut)


def _last_places(position: Array) -> Array:
    """The last known position of each ball in (n, nball, 2): (nball, 2) [m]."""
    last = np.array([np.flatnonzero(np.isfinite(position[:, k, 0]))[-1] for k in range(position.shape[1])])
    return np.asarray(position[last, np.arange(position.shape[1])])
