"""Verbs with a single request to the launcher, and the emulated launcher at a port."""

from __future__ import annotations

import signal
from functools import partial
from typing import TYPE_CHECKING, Any

import click

from models.commands.console import Status
from models.commands.options import Number, gathered, seed_option
from models.messages import counted
from robot.cli import first_byte
from robot.cli.common import RequiredWire
from robot.device.protocol import CUELAB, PAPER, PROTOCOLS

if TYPE_CHECKING:
    from robot.device.outcome import Did
    from robot.device.protocol import LauncherStatus

HOLDER_ANSWERS_S = 2.0  # longest time that the port's holder may take to ask the launcher


@click.command()
@click.option("--path", metavar="P", help="Path of the port; by default a new one.")
@click.option("--baud", metavar="B", type=int, default=19200, show_default=True, help="Speed of the line [bit/s].")
@click.option("--pace", metavar="X", type=float, default=1.0, show_default=True, help="Mechanics over real time.")
@click.option("--fault-rate", metavar="R", type=Number(0, 1), default=0.0, help="Share of lines with a fault, 0 to 1.")
@click.option(
    "--protocol", type=click.Choice(PROTOCOLS), default=CUELAB, show_default=True, help="Protocol of the launcher."
)
@seed_option()
def emulate(path: str | None, baud: int, pace: float, fault_rate: float, protocol: str, seed: int) -> int:
    """Emulate a launcher on a pseudo-terminal, until interrupted.

    Prints the path of the port first, then a line for everything that the launcher does.

    Example: robot emulate --pace 10
    """
    from robot.emulator.firmware import Firmware
    from robot.emulator.launcher import serve
    from robot.emulator.paper import PaperFirmware

    for name in (signal.SIGINT, signal.SIGTERM):  # so that the port is removed, also when started from a script
        signal.signal(name, signal.default_int_handler)
    firmware = PaperFirmware if protocol == PAPER else Firmware
    serve(path, firmware, say=partial(print, flush=True), baud=baud, pace=pace, fault_rate=fault_rate, seed=seed)
    return Status.DONE


def _request(name: str, text: str, moves: bool = False) -> click.Command:
    """A verb that calls one method of the driver."""

    @click.command(name, help=f"{text}\n\nExample: robot {name} --port /dev/ttyUSB0")
    @gathered("wire", RequiredWire)
    def request(wire: RequiredWire) -> int:
        settings = wire.settings()
        if moves:
            wire.print_needs(asks="")
        with wire.launcher(settings) as launcher:
            return _report(getattr(launcher, name)())

    return request


@click.command()
@gathered("wire", RequiredWire)
def status(wire: RequiredWire) -> int:
    """Print the state of the launcher.

    It works while another program holds the port, and then names that program.

    Example: robot status --port /dev/ttyUSB0
    """
    from robot.device.protocol import parse_status
    from robot.device.relay import STATUS, ask, this_program

    settings = wire.settings()
    holder = ask(settings.port.device, STATUS, this_program(), HOLDER_ANSWERS_S)
    if holder is None:
        with wire.launcher(settings) as launcher:
            return _report(launcher.status())
    answer = holder.answer or {}
    found = parse_status(str(answer.get("status")))
    if found is None:
        why = answer.get("error", "no answer")
        print(f"{holder} holds the port and has no status ({why}); robot stop works all the same")
        return Status.FINDING
    status = _print_status(found, *settings.tip_mm(found.x_um, found.y_um))
    print(f"{holder} holds the port{_busy_with(answer)}; robot stop works all the same")
    return status


def _busy_with(answer: dict[str, Any]) -> str:
    return f", last with {answer['doing']}" if answer.get("doing") else ""


reset = _request("reset", "Reset the launcher after a stop or a fault.")
home = _request("home", "Move rack and stage to their switches.", moves=True)


@click.command()
@gathered("wire", RequiredWire)
def stop(wire: RequiredWire) -> int:
    """Stop the launcher at once.

    It works while another program holds the port, and prints what was interrupted. Status 1 if the launcher does not
    confirm the stop.

    Example: robot stop --port /dev/ttyUSB0
    """
    from robot.device.paper import PAPER_LIMITS
    from robot.device.past_lock import stop_past_lock

    settings = wire.settings()
    if settings.port.protocol == PAPER:
        print(PAPER_LIMITS)
        return Status.FINDING
    stopped, holder = stop_past_lock(settings, wire.log, first_byte.asked.pop(settings.port.device, None))
    if holder is not None:
        silent = " and does not answer" if holder.answer is None else ""
        print(f"{holder} holds the port{silent}{_busy_with(holder.answer or {})}")
    sent = f"{stopped.bytes_sent} bytes" if stopped.bytes_sent != 1 else "1 byte"
    if not stopped.confirmed:
        print(f"not confirmed after {sent}: cut the power")
        return Status.FINDING
    was = f" from {stopped.interrupted}" if stopped.interrupted else ""
    print(f"stopped, confirmed in {1e3 * stopped.seconds:.0f} ms ({sent}){was}; robot reset leaves it")
    return Status.DONE


def _report(did: Did) -> int:
    status = _print_status(did.status, did.x0_mm, did.y0_mm)
    for line in did.noted:
        print(f"noted: {line}")
    return status


def _print_status(s: LauncherStatus, x0_mm: float, y0_mm: float) -> int:
    since = [counted(s.done, "stroke"), counted(s.stops, "stop"), counted(s.boots, "boot")]
    print(f"{s.state}: tip at {x0_mm:+.2f}, {y0_mm:+.2f} mm, {', '.join(since)}")
    for line in s.troubles():
        print(f"noted: {line}")
    return Status.FINDING if s.state in ("STOPPED", "FAULT") else Status.DONE
