"""Verbs of the `robot` command that ask one thing of the launcher, and the emulated launcher at a port."""

from __future__ import annotations

import signal
from functools import partial
from typing import TYPE_CHECKING

import click

from models.command_line import Number, gathered, seed_option
from models.console import Status
from robot.cli.common import RequiredWire

if TYPE_CHECKING:
    from robot.device.outcome import Did


@click.command()
@click.option("--path", metavar="P", help="Path of the port; by default a new one.")
@click.option("--baud", metavar="B", type=int, default=19200, show_default=True, help="Speed of the line [bit/s].")
@click.option("--pace", metavar="X", type=float, default=1.0, show_default=True, help="Mechanics, over real time.")
@click.option("--fault-rate", metavar="R", type=Number(0, 1), default=0.0, help="Share of lines with a fault, 0 to 1.")
@seed_option()
def emulate(path: str | None, baud: int, pace: float, fault_rate: float, seed: int) -> int:
    """Emulate a launcher on a pseudo-terminal, until interrupted.

    Prints the path of the port first, then a line for everything that the launcher does.

    Example: robot emulate --pace 10
    """
    from robot.emulator.launcher import serve

    for name in (signal.SIGINT, signal.SIGTERM):  # so that the port is removed too, also when started from a script
        signal.signal(name, signal.default_int_handler)
    serve(path, say=partial(print, flush=True), baud=baud, pace=pace, fault_rate=fault_rate, seed=seed)
    return Status.DONE


def _request(name: str, text: str, moves: bool = False) -> click.Command:
    """A verb that is one method of the driver."""

    @click.command(name, help=f"{text}\n\nExample: robot {name} --port /dev/ttyUSB0")
    @gathered("wire", RequiredWire)
    def request(wire: RequiredWire) -> int:
        settings = wire.settings()
        if moves:
            wire.print_needs(asks="")
        with wire.launcher(settings) as launcher:
            return _report(getattr(launcher, name)())

    return request


status = _request("status", "Print the state of the launcher.")
reset = _request("reset", "Reset the launcher after a stop or a fault.")
home = _request("home", "Move rack and stage to their switches.", moves=True)


@click.command()
@gathered("wire", RequiredWire)
def stop(wire: RequiredWire) -> int:
    """Stop the launcher at once.

    Status 1 if the launcher does not confirm it.

    Example: robot stop --port /dev/ttyUSB0
    """
    with wire.link(wire.settings()) as link:
        stopped = link.stop()
    sent = f"{stopped.bytes_sent} bytes" if stopped.bytes_sent != 1 else "1 byte"
    if not stopped.confirmed:
        print(f"not confirmed after {sent}: cut the power")
        return Status.FINDING
    print(f"stopped, confirmed in {1e3 * stopped.seconds:.0f} ms ({sent}); robot reset leaves it")
    return Status.DONE


def _report(did: Did) -> int:
    s = did.status
    print(
        f"{s.state}: tip at {did.x0_mm:+.2f}, {did.y0_mm:+.2f} mm, {s.done} strokes, {s.stops} stops, {s.boots} boots"
    )
    for line in (*s.troubles(), *did.noted):
        print(f"noted: {line}")
    return Status.FINDING if s.state in ("STOPPED", "FAULT") else Status.DONE
