"""Verbs that measure the launcher's strings: their repeatability, and their cue speeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click

from models.commands.console import Progress, Status, table, write_json
from models.commands.options import gathered, json_option, out_option, seed_option
from models.errors import BadInput
from robot.cli.common import Filming, Wire, confirmed, yes_option
from robot.cli.single_ball import AtTable
from robot.device.protocol import LauncherError


class StringsCommand(click.Command):
    """A command whose option --strings takes several numbers."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Rewrite `--strings 40 160` for click: `--strings 40 --strings 160`."""
        return super().parse_args(ctx, list(_repeated("--strings", args)))


def _repeated(option: str, words: Sequence[str]) -> Iterator[str]:
    """The words with the option repeated before each of its values."""
    values = 0  # values of the option seen, plus one
    for word in words:
        if word.startswith("-"):
            values = int(word == option)
        elif values:
            if values > 1:
                yield option
            values += 1
        yield word


def strings_option(default: str) -> Any:
    """The option for the strings to strike."""
    text = f"Strings to strike, one or more; by default {default}."
    return click.option("--strings", metavar="N...", type=int, multiple=True, help=text)


def repeats_option(default: int) -> Any:
    """The option for the number of strokes of each."""
    return click.option("--repeats", metavar="N", type=int, default=default, show_default=True, help="Strokes of each.")


@click.command(cls=StringsCommand)
@gathered("wire", Wire)
@gathered("filming", Filming)
@gathered("at_table", AtTable)
@strings_option("15 over the launcher's speeds")
@repeats_option(20)
@seed_option()
@json_option
@click.pass_obj
def repeat(
    progress: Progress, wire: Wire, filming: Filming, at_table: AtTable, strings: tuple[int, ...], repeats: int,
    seed: int, json_file: Path | None,
) -> int:  # fmt: skip
    """Repeat strokes of each string, to measure the scatter of the balls' end points.

    With --port and a camera it runs at a table, where a person puts the ball back for every stroke; without, on the
    emulated launcher, on a snooker table and on an unlimited cloth.

    Example: robot repeat --strings 60 160 --repeats 5
    """
    if wire.port:
        return _repeat_at_table(wire, filming, at_table, strings, repeats, json_file)
    wire.refuse("log")
    filming.refuse()
    at_table.refuse()
    from models.table.snooker import SNOOKER_TABLE
    from robot.cueing.repeated import result, spread_strings, text
    from robot.emulator.repeatability import OPEN_CLOTH, Conditions, measure

    print("no --port: using the emulated launcher")
    settings = wire.settings()
    chosen = list(strings) or spread_strings(settings)
    on_table, on_cloth = [
        measure(settings, chosen, repeats, seed, Conditions(cloth), progress) for cloth in (SNOOKER_TABLE, OPEN_CLOTH)
    ]
    progress.close()
    print(f"snooker table\n{text(on_table)}\n\nunlimited cloth\n{text(on_cloth)}\n")
    if json_file:
        write_json(json_file, result({"table": on_table, "open": on_cloth}, seed))
    return Status.DONE


def _repeat_at_table(
    wire: Wire, filming: Filming, at_table: AtTable, strings: tuple[int, ...], repeats: int, json_file: Path | None
) -> int:  # fmt: skip
    """Repeat strokes at the port: print each string's row as soon as it is measured, then all."""
    from robot.cueing.repeated import Repeated, result, rows, spread_strings, text
    from robot.table.strokes import check_strokes, measure_repeats

    filming.require("the measurement")
    if repeats < 2:
        raise BadInput(f"repeats is {repeats}; give 2 or more")
    settings = wire.settings()
    chosen = list(dict.fromkeys(strings)) or spread_strings(settings)
    if not chosen:
        raise BadInput("no string is within the limits of the launcher's file; give --strings")
    left = list(chosen)

    def report(row: Repeated) -> None:
        left.remove(row.string)
        print(table(rows([row])), flush=True)

    try:
        with at_table.ball(wire, filming, settings) as rig:
            check_strokes(settings, [(n, 0.0, 0.0) for n in chosen], rig)
            at_table.print_needs(wire, filming, rig, repeats * len(chosen))
            measured = measure_repeats(rig, chosen, repeats, report)
    except (KeyboardInterrupt, BadInput, LauncherError) as end:
        if len(left) < len(chosen):
            end.add_note(f"measure the rest with: --strings {' '.join(map(str, left))}")
        raise
    print(f"\nthis table\n{text(measured)}")
    if json_file:
        write_json(json_file, result({"table": measured}))
    return Status.DONE


@click.command(cls=StringsCommand)
@out_option("NEW.toml", "File for the new launcher settings.")
@gathered("wire", Wire)
@strings_option("9 of the 200")
@repeats_option(5)
@seed_option()
@yes_option
@json_option
@click.pass_obj
def calibrate(
    progress: Progress, out: Path, wire: Wire, strings: tuple[int, ...], repeats: int, seed: int, yes: bool,
    json_file: Path | None,
) -> int:  # fmt: skip
    """Calibrate the strings: measure the cue speed of each.

    Strikes without a ball, and writes a launcher's file with the speeds. Without --port it uses the emulated launcher.

    Example: robot calibrate --port /dev/ttyUSB0 --out launcher.toml
    """
    import numpy as np

    from robot.device.calibrate import CALIBRATION_STRINGS, measure_strings, result, text, write_calibration
    from robot.emulator.table import emulated_launcher

    settings, chosen = wire.settings(), list(strings) or list(CALIBRATION_STRINGS)
    if wire.port:
        wire.print_needs("no ball in front of the cue: it strikes the air", asks="once, before all strokes,", yes=yes)
        action = f"{repeats * len(chosen)} times without a pause, {repeats} of each of {chosen}"
        if not yes and not confirmed(action, "take the ball away"):
            raise BadInput("not confirmed, so nothing was struck; answer yes to strike")
        launcher = wire.launcher(settings)
    else:
        print("no --port: using the emulated launcher, whose strings follow the settings")
        launcher = emulated_launcher(settings, lambda *_: None, np.random.default_rng(seed), log=wire.log)[0]
    with launcher:
        measured = measure_strings(launcher, chosen, repeats, progress)
    progress.close()
    print(text(measured, settings))  # before the file is written: speeds that do not fall are refused, but shown
    write_calibration(wire.settings_file, measured, out)
    print(f"launcher's file: {out}")
    if json_file:
        write_json(json_file, result(measured))
    return Status.DONE
