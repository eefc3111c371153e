"""The `robot` command: the emulated launcher, plans played, single verbs; what measures and learns is in its own files.

Without --port nothing real moves: plans go to an emulated launcher at an emulated table, and the command says so. An
interrupt stops the launcher before anything else (robot/link.py).
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from models.errors import BadInput
from robot import cli_learn, cli_measure
from robot.cli_common import Run, confirmed, launcher_at, line_of, seed_of, seeded, settings_of, wired, with_effects
from robot.protocol import LauncherError
from sysid.cli import BAD, DONE, FOUND, INTERRUPTED, own_effects
from sysid.output import Progress

if TYPE_CHECKING:
    from models.shot import Array, Ball, Table
    from planner.scene import Scene
    from robot.emulated_table import EmulatedTable
    from robot.launcher import Did, Launcher
    from robot.play import Played
    from robot.settings import Settings
    from sysid.clips import Observation

FIRMWARE = 1  # beside the seed: its draws are not the table's


def emulate(args: argparse.Namespace, progress: Progress) -> int:
    """Serve an emulated launcher on a pseudo-terminal until interrupted."""
    from robot.emulator import serve

    def say(line: str) -> None:
        print(line, flush=True)

    signal.signal(signal.SIGTERM, signal.default_int_handler)  # so that the port goes away too
    if not 0 <= args.fault_rate <= 1:
        raise BadInput(f"--fault-rate {args.fault_rate:g}: give a share of the lines, 0 to 1")
    rest = {"baud": args.baud, "pace": args.pace, "fault_rate": args.fault_rate, "seed": seed_of(args)}
    serve(args.path, say=say, **rest)
    return DONE


@dataclass(frozen=True)
class SeenScene:
    """Balls as a scene file has them, made from a picture a moment ago; it films nothing."""

    scene: Scene
    fps: float = 1.0
    sigma: float = 0.0

    @property
    def table(self) -> Table:
        """Of the scene."""
        return self.scene.table

    @property
    def ball(self) -> Ball:
        """Of the scene."""
        return self.scene.ball

    def look(self) -> Mapping[str, Array]:
        """Where the balls are, by name: (2,) [m]."""
        return dict(zip(self.scene.names, self.scene.position, strict=True))

    def arm(self) -> None:
        """Nobody films."""

    def film(self) -> Mapping[str, Observation]:
        """Nothing."""
        return {}


def play(args: argparse.Namespace, progress: Progress) -> int:
    """Play a plan once, on the launcher at a port or on the emulated one."""
    from planner.scene import read_scene
    from robot.play import play_plan, read_order

    settings = settings_of(args)
    order = read_order(args.plan, settings)
    scene = read_scene(args.scene) if args.scene else None
    if args.tolerance <= 0:
        raise BadInput(f"--tolerance {args.tolerance:g}: give millimetres above 0")
    most = 1e-3 * args.tolerance
    if args.port:
        for name in ("model", "clips", "fault_rate"):
            if getattr(args, name):
                raise BadInput(
                    f"--{name.replace('_', '-')} belongs to the emulated launcher; leave it out, or leave --port out "
                    "(tracked clips of a real stroke: sysid track VIDEO)"
                )
        camera = SeenScene(scene) if scene else None
        if camera is None:
            print("no --scene: nobody has looked where the balls are; make one with: planner scene PICTURE")
        if args.dry_run:
            played = play_plan(args.plan, _dry(settings), camera, tolerance=most)
        else:
            with launcher_at(args, settings) as launcher:
                played = play_plan(args.plan, launcher, camera, None if args.yes else _confirmed, tolerance=most)
        return _tell(played, args, None)
    print("no --port: on the emulated launcher and table")
    emulated = _emulated_table(args, scene or order.scene, np.radians(order.yaw_deg))
    if args.dry_run:
        return _tell(play_plan(args.plan, _dry(settings), emulated, clips=args.clips, tolerance=most), args, None)
    with _emulated_launcher(args, settings, emulated) as launcher:
        played = play_plan(args.plan, launcher, emulated, clips=args.clips, tolerance=most)
    return _tell(played, args, emulated)


def _emulated_table(args: argparse.Namespace, scene: Scene, azimuth: float) -> EmulatedTable:
    """The balls of a scene on a table that only the emulator knows."""
    from models.model_file import full_model, read_model
    from robot.emulated_table import EmulatedTable

    model = read_model(args.model) if args.model else full_model(scene.table, scene.ball)
    if not args.model:
        print("no --model: the table is the base with its usual constants")
    if (model.table, model.ball) != (scene.table, scene.ball):
        raise BadInput(f"{args.model}: is of another table or ball than the scene; name a model of the scene's")
    places = {n: (float(x), float(y)) for n, (x, y) in zip(scene.names, scene.position, strict=True)}
    return EmulatedTable(model, places, azimuth, seed_of(args))


def _emulated_launcher(args: argparse.Namespace, settings: Settings, emulated: EmulatedTable) -> Launcher:
    from robot.emulated_table import emulated_launcher
    from robot.faults import Faults

    rng, chance = np.random.default_rng((seed_of(args), FIRMWARE)).spawn(2)
    faults = Faults(args.fault_rate, chance) if args.fault_rate else None
    return emulated_launcher(settings, emulated.hit, rng, faults=faults, log=args.log)[0]


def _dry(settings: Settings) -> Launcher:
    from robot.launcher import Launcher

    return Launcher(settings, None, dry_run=True)


def _confirmed(what: str) -> bool:
    return confirmed(what, "turn the stand")


def _tell(played: Played, args: argparse.Namespace, emulated: EmulatedTable | None) -> int:
    """What became of the plan, in words and figures."""
    from robot.play import played_file

    if played.struck == "dry":
        print("dry run: nothing has moved, nothing was written")
        return DONE
    done = played.done
    if done is not None:
        print(
            f"struck {done.string}: cue {done.cue_speed:.3f} m/s ({done.asked_speed:.3f} asked), "
            f"peak {done.peak_force:.0f} N, tip at {done.x0_mm:+.2f}, {done.y0_mm:+.2f} mm"
        )
    if played.potted is not None:
        print(f"object ball: {f'potted, {played.pocket}' if played.potted else played.pocket or 'not potted'}")
    if played.cue_fell:
        print("cue ball: in-off")
    elif played.cue_end is not None:
        away = "" if played.from_wanted is None else f", {1e3 * played.from_wanted:.0f} mm from the wanted place"
        print(f"cue ball: {played.cue_end[0]:.4f}, {played.cue_end[1]:.4f} m{away}")
    for line in played.noted:
        print(f"noted: {line}")
    if played.clip:
        print(f"clip: {Path(args.clips) / played.clip}")
    print(f"played: {played_file(args.plan)}")
    if emulated is not None and emulated.strokes != 1:
        print(f"the emulated cue ball was struck {emulated.strokes} times")
    troubled = any("the cue is not back" in line or "the film is lost" in line for line in played.noted)
    return FOUND if troubled else DONE


def ask(args: argparse.Namespace, progress: Progress) -> int:
    """One command of the launcher's that needs no words: its verb is the driver's method."""
    with launcher_at(args, settings_of(args)) as launcher:
        did = {"status": launcher.status, "reset": launcher.reset, "home": launcher.home}[args.verb]()
    return _report(did)


def stop(args: argparse.Namespace, progress: Progress) -> int:
    """Stop everything, without a word before."""
    with line_of(args, settings_of(args)) as line:
        stopped = line.stop()
    sent = f"{stopped.bytes_sent} bytes" if stopped.bytes_sent != 1 else "1 byte"
    if not stopped.confirmed:
        print(f"not confirmed after {sent}: cut the power")
        return FOUND
    print(f"stopped, confirmed in {1e3 * stopped.seconds:.0f} ms ({sent}); robot reset leaves it")
    return DONE


def _report(did: Did) -> int:
    s = did.status
    print(
        f"{s.state}: tip at {did.x0_mm:+.2f}, {did.y0_mm:+.2f} mm, {s.done} strokes, {s.stops} stops, {s.boots} boots"
    )
    for line in (*s.troubles(), *did.noted):
        print(f"noted: {line}")
    return FOUND if s.state in ("STOPPED", "FAULT") else DONE


def parser() -> argparse.ArgumentParser:
    """The command line."""
    top = argparse.ArgumentParser(prog="robot", description="The launcher, with and without hardware.")
    verbs = top.add_subparsers(dest="verb", required=True)

    def verb(name: str, run: Run, text: str) -> argparse.ArgumentParser:
        one = verbs.add_parser(name, help=text, description=text[0].upper() + text[1:] + ".", allow_abbrev=False)
        one.set_defaults(run=run, effects=[])
        return one

    one = verb("emulate", emulate, "an emulated launcher on a pseudo-terminal; its path is printed first")
    one.add_argument("--path", metavar="P", help="of the port (default: a new one)")
    one.add_argument("--baud", metavar="B", type=int, default=19200, help="bit/s (default: 19200)")
    one.add_argument("--pace", metavar="X", type=float, default=1.0, help="of the mechanics, over real time")
    one.add_argument("--fault-rate", metavar="R", type=float, default=0.0, help="share of lines with a fault, 0 to 1")
    seeded(one, 0)
    one = verb("play", play, "a plan played once; without --port on the emulated launcher and table")
    one.add_argument("plan", metavar="PLAN.json", help="plan file; PLAN.played.json is written beside it")
    wired(one, required=False)
    one.add_argument("--scene", metavar="SCENE.toml", help="where the balls are now (made with: planner scene PICTURE)")
    one.add_argument("--tolerance", metavar="MM", type=float, default=5.0, help="of each ball's place (default: 5)")
    one.add_argument("--clips", metavar="DIR", help="clip set that the emulated camera's film is added to")
    one.add_argument("--model", metavar="HIDDEN.toml", help="what the emulated table really is (default: the base)")
    with_effects(one)
    one.add_argument("--fault-rate", metavar="R", type=float, default=0.0, help="share of lines with a fault, emulated")
    seeded(one, 0)
    one.add_argument("--dry-run", action="store_true", help="check, and say what would be sent")
    one.add_argument("--yes", action="store_true", help="strike without asking; look at the table first")
    cli_measure.add(verb)
    cli_learn.add(verb)
    for name, run, text in (
        ("status", ask, "how the launcher is"),
        ("stop", stop, "everything stopped now"),
        ("reset", ask, "out of the stopped state, or a fault"),
        ("home", ask, "rack and stage to their switches"),
    ):
        wired(verb(name, run, text), required=True)
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Run a verb: 0 done, 1 the launcher needs looking after, 2 bad input."""
    args = parser().parse_args(argv)
    progress = Progress()
    try:
        own_effects(args.effects)
        return int(args.run(args, progress))
    except BadInput as error:
        progress.close()
        print(f"robot {args.verb}: {error}", file=sys.stderr)
        return BAD
    except LauncherError as error:
        progress.close()
        print(f"robot {args.verb}: {error}", file=sys.stderr)
        return FOUND
    except KeyboardInterrupt:
        progress.close()
        stopped = "; the launcher was stopped, reset and home it" if getattr(args, "port", None) else ""
        print(f"robot {args.verb}: interrupted{stopped}", file=sys.stderr)
        return INTERRUPTED


if __name__ == "__main__":
    sys.exit(main())
