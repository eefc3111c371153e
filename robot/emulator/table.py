"""An emulated table with hidden parameters for the emulated launcher, to run the closed loop without hardware.

In: the hidden model, the balls' positions, hits from the firmware (`hit`: cue speed, side and height of the axis). Out:
a `robot.play.ShotCamera`. The tip of a launcher with hidden constants strikes in MuJoCo (models/mujoco/struck.py), and
the hidden model plays the shot there, with jaws at the pockets, until all balls rest; a camera straight above reports
positions with normal noise, from the hit (t = 0) on. The stand is turned by hand, each time with an error.

A hit is only recorded, since it comes during an exchange; the shot is played at the next look. The stand is set for one
stroke, since the cue ball moves. Left out: the hop after the hit, a marked ball's angle, and the camera's distortions:
the model's camera effects are dropped, and so is a fitted squirt, which would count twice. Of the launcher's constants,
friction on the slate is that of the hidden cloth, and the contact time of the tip follows from its leather.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from models.analytic.cue_impulse import Constants
from models.errors import BadInput
from models.mjcf.launcher import CueProperties
from models.model_file import Model
from models.mujoco.launcher import SimulatedStroke
from models.mujoco.struck import TipStroke, play_struck, without_squirt
from models.shot import GRAVITY, Array, Track
from robot.cueing.striker import CAMERA_FPS
from robot.device.launcher import Launcher
from robot.device.link import Link
from robot.device.settings import Settings
from robot.emulator.faults import FaultInjection
from robot.emulator.firmware import Firmware
from robot.emulator.line import Line, VirtualClock, WirePort
from sysid.clips import Observation

PLACE_SIGMA_M = 5e-4  # noise of an observed position, each axis
YAW_SETTING_SD = 1e-3  # error of a yaw set by hand with the camera [rad]; planner/launcher/execution.py
AVERAGED_FRAMES = 25  # frames averaged in a look at resting balls
MIN_MOTION_M = 1e-6  # least change of position of a ball that has moved
FRAMES_AFTER_REST = 10  # frames kept after the last motion
SHOT_HOOKS = ("edit", "forces", "horizon", "impact", "strike")  # hooks through which an effect changes a shot
BASE_EFFECTS = ("decoupled_cloth", "ball_impact", "cushion_impact")  # needed for jaws at the pockets


@dataclass(frozen=True)
class EmulatedOptions:
    """Options of an emulated table."""

    sigma: float = PLACE_SIGMA_M  # of the camera's noise, each axis [m]
    fps: float = CAMERA_FPS  # of the camera [1/s]
    yaw_sd: float = YAW_SETTING_SD  # error of the stand's azimuth each time that it is turned [rad]
    constants: Constants = field(default_factory=Constants)  # hidden, of the launcher; zeros are true minus stage


class EmulatedTable:
    """Balls, a stand turned by hand, and a camera; `hit` is the firmware's `on_strike`."""

    def __init__(
        self,
        model: Model,
        position: Mapping[str, tuple[float, float]],
        azimuth: float,
        seed: int = 0,
        options: EmulatedOptions | None = None,
    ) -> None:
        """Place the balls, and the stand behind the first of them.

        Args:
            model: the hidden one.
            position: of every ball by name, the cue ball first [m].
            azimuth: to which the stand is turned by hand [rad].
            seed: of all random numbers.
            options: errors and launcher that differ from the defaults.

        Raises:
            BadInput: no balls, or a model that lacks cloth, ball or cushion impacts.
        """
        if not position:
            raise BadInput("position is empty; give at least a cue ball")
        doing = tuple(e for e in without_squirt(model).stack()[1:] if e.opens(*SHOT_HOOKS) or e.slot)
        if lacking := sorted(set(BASE_EFFECTS) - {e.name() for e in doing}):
            raise BadInput(f"the hidden model lacks {', '.join(lacking)}; give one based on the base")
        self.model = dataclasses.replace(model, effects=doing, engine="mujoco")  # fits and plans use the event engine
        self.options = options or EmulatedOptions()
        self.table, self.ball, self.fps, self.sigma = model.table, model.ball, self.options.fps, self.options.sigma
        hidden = self.options.constants
        self.device = CueProperties(hidden.cue_mass, hidden.end_mass, hidden.tip_restitution)
        self.made: SimulatedStroke | None = None  # the last stroke that met the cue ball
        self._rng = np.random.default_rng(seed)
        self._places = {name: np.array(xy, float) for name, xy in position.items()}
        self._cue = next(iter(position))
        self._hits: list[tuple[float, float, float]] = []
        self._filmed: dict[str, Observation] = {}
        self.strokes = 0  # strokes that met the cue ball
        self.track: Track | None = None  # of the last shot, without noise
        self.turn_to(azimuth)

    @property
    def doubts(self) -> tuple[str, ...]:
        """No doubts: it knows the true positions."""
        return ()

    @property
    def filmed(self) -> None:
        """None: there is no video."""

    def turn_to(self, azimuth: float) -> None:
        """Place the stand behind the cue ball, turned by hand."""
        self.azimuth = azimuth + self.options.yaw_sd * float(self._rng.standard_normal())
        self._ready = self._cue in self._places

    def hit(self, cue_speed: float, side: float, height: float) -> None:
        """Record a hit at the cue ball's place: speed [m/s], side and height of the axis [m]."""
        self._hits.append((cue_speed, side, height))

    def look(self) -> dict[str, Array]:
        """Observed positions of the resting balls by name: (2,) [m]."""
        self._play()
        noise = self.sigma / math.sqrt(AVERAGED_FRAMES)
        return {name: xy + noise * self._rng.standard_normal(2) for name, xy in self._places.items()}

    def arm(self) -> None:
        """Do nothing: every hit is observed."""

    def film(self) -> dict[str, Observation]:
        """The tracks since the last film ended, from the hit on; empty if nothing was struck."""
        self._play()
        filmed, self._filmed = self._filmed, {}
        return filmed

    def stroke(self, cue_speed: float, side: float, height: float) -> TipStroke:
        """The true hit, including the zeros of stage and aim."""
        c = self.options.constants
        return TipStroke(cue_speed, self.azimuth + c.aim_zero, side + c.side_zero, height + c.height_zero)

    def _play(self) -> None:
        """Play the hits since the last look; a tip that misses the ball moves nothing."""
        hits, self._hits = self._hits, []
        if hits and self._ready:
            self._ready = False
            self.strokes += 1
            self.track = self._shot(*hits[0])
            self._filmed = self._seen(self.track)
            last = self.track.position[-1]
            self._places = {n: last[k] for k, n in enumerate(self.track.names) if np.isfinite(last[k, 0])}

    def _shot(self, cue_speed: float, side: float, height: float) -> Track:
        """Play the whole shot; a tip that misses the ball moves nothing."""
        names = (self._cue, *(n for n in self._places if n != self._cue))
        roll = float(self.model.parameters()["decoupled_cloth.roll"])
        longest = 2.0 * (2.0 * cue_speed / (roll * GRAVITY)) + 1.0  # a ball is at most twice as fast as the cue
        times = np.arange(math.ceil(longest * self.fps) + 1) / self.fps
        [track], [self.made] = play_struck(
            self.model, {n: self._places[n] for n in names}, [self.stroke(cue_speed, side, height)], [times],
            device=self.device, jaws=True, threads=1,
        )  # fmt: skip
        return track

    def _seen(self, track: Track) -> dict[str, Observation]:
        """The track as reported by the camera, until shortly after the last motion."""
        xy = track.position
        moved = np.abs(np.diff(xy, axis=0)).max(axis=(1, 2), initial=0.0, where=np.isfinite(np.diff(xy, axis=0)))
        gone = np.isnan(xy[..., 0]).sum(axis=1)
        busy = np.flatnonzero((moved > MIN_MOTION_M) | (np.diff(gone) > 0))
        end = min((int(busy[-1]) if busy.size else 0) + 2 + FRAMES_AFTER_REST, len(track.times))
        out = {}
        for k, name in enumerate(track.names):
            own = np.flatnonzero(np.isfinite(xy[:end, k, 0]))
            seen = xy[own, k] + self.sigma * self._rng.standard_normal((len(own), 2))
            out[name] = Observation(track.times[own], seen, np.full(len(own), math.nan))
        return out


def emulated_launcher(
    settings: Settings,
    on_strike: Callable[[float, float, float], None],
    rng: np.random.Generator,
    *,
    faults: FaultInjection | None = None,
    log: Path | str | None = None,
    say: Callable[[str], None] = print,
) -> tuple[Launcher, Firmware]:
    """A launcher with these settings on a virtual line, where waiting takes no time; its strings are as calibrated."""
    clock, table = VirtualClock(), settings.calibration

    def law(string: int) -> float:
        return float(np.interp(string, table.strings, table.speeds))

    device = Firmware(clock.now, rng, on_strike=on_strike, law=law)
    line = clock.line = Line(device, baud=settings.port.baud, faults=faults)
    link = Link(lambda: WirePort(line, clock), settings.timing, baud=settings.port.baud, clock=clock, log=log)
    return Launcher(settings, link, say=say), device
