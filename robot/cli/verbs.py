"""The `robot` command: the emulated launcher and single verbs; what plays, measures and learns is in its own files.

Without --port nothing real moves: plans go to an emulated launcher at an emulated table, and the command says so. An
interrupt stops the launcher before anything else (robot/device/link.py).
"""

from __future__ import annotations

import argparse
import signal
from collections.abc import Sequence
from typing import TYPE_CHECKING

from models.console import DONE, FOUND, Progress, Run, run_verb
from models.errors import BadInput
from robot.cli import learn, measure, play
from robot.cli.common import launcher_at, line_of, seed_of, seeded, settings_of, wired
from robot.device.protocol import LauncherError

if TYPE_CHECKING:
    from robot.device.outcome import Did


def emulate(args: argparse.Namespace, progress: Progress) -> int:
    """Serve an emulated launcher on a pseudo-terminal until interrupted."""
    from robot.emulator.launcher import serve

    def say(line: str) -> None:
        print(line, flush=True)

    for name in (signal.SIGINT, signal.SIGTERM):  # so that the port goes away too, also when started from a script
        signal.signal(name, signal.default_int_handler)
    if not 0 <= args.fault_rate <= 1:
        raise BadInput(f"--fault-rate {args.fault_rate:g}: give a share of the lines, 0 to 1")
    rest = {"baud": args.baud, "pace": args.pace, "fault_rate": args.fault_rate, "seed": seed_of(args)}
    serve(args.path, say=say, **rest)
    return DONE


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
    play.add(verb)
    measure.add(verb)
    learn.add(verb)
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
    stopped = "; the launcher was stopped, reset and home it" if getattr(args, "port", None) else ""
    return run_verb("robot", args, stopped, (LauncherError,))
