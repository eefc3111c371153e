"""Verbs of the `robot` command that measure the launcher: its cueing map, how well it repeats, its strings' speeds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import click

from models.command_line import (
    FILE_PATH,
    OUTPUT_FILE,
    Number,
    gathered,
    json_option,
    out_option,
    output_option,
    seed_option,
)
from models.console import Progress, Status, table, write_json
from models.errors import BadInput
from models.files import alone_in
from robot.cli.common import Wire, confirmed, settings_option, yes_option


class StringsCommand(click.Command):
    """A command whose --strings takes several numbers."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """`--strings 40 160` as click has it: `--strings 40 --strings 160`."""
        return super().parse_args(ctx, list(_repeated("--strings", args)))


def _repeated(option: str, words: Sequence[str]) -> Iterator[str]:
    """The words, with the option before each of its values."""
    values = 0  # of the option, and one
    for word in words:
        if word.startswith("-"):
            values = int(word == option)
        elif values:
            if values > 1:
                yield option
            values += 1
        yield word


def strings_option(default: str) -> Any:
    """The strings to be struck."""
    text = f"Strings to strike, one or more; by default {default}."
    return click.option("--strings", metavar="N...", type=int, multiple=True, help=text)


def repeats_option(default: int) -> Any:
    """How often each is struck."""
    return click.option("--repeats", metavar="N", type=int, default=default, show_default=True, help="Strokes of each.")


@click.command()
@click.argument("out", metavar="OUT.csv", type=OUTPUT_FILE)
@click.option("--most", metavar="N", type=Number(1, whole=True), help="Stop after so many more shots.")
@seed_option(1)
@click.pass_obj
def campaign(progress: Progress, out: Path, most: int | None, seed: int) -> int:
    """Play the published grid of strokes on the emulated launcher.

    Writes a row for each shot into OUT.csv; an old file is continued.

    Example: robot campaign shots.csv
    """
    import numpy as np

    from models.mjcf.gl import choose_backend

    choose_backend()
    from robot.cueing.campaign import count_played, run_campaign
    from robot.cueing.striker import EmulatedStriker, Sloppiness, draw_hidden

    click.get_current_context().with_resource(alone_in(out))
    print("on the emulated launcher, with constants drawn from the seed")
    hidden = draw_hidden(np.random.default_rng(seed))
    striker = EmulatedStriker(hidden, Sloppiness(), seed, count_played(out))
    try:
        shots = run_campaign(striker, out, seed, progress, most=most)
    except KeyboardInterrupt as end:
        end.add_note(f"{count_played(out)} shots are kept in {out}: the same command continues from there")
        raise
    progress.close()
    print(f"{len(shots)} shots, {sum(s.miscue for s in shots)} miscues: {out}")
    return Status.DONE


@click.command("map")
@click.argument("campaign", metavar="CSV", type=FILE_PATH)
@out_option("MAP.toml", "Where the map goes; planner plan --map reads it.")
@output_option("report", "H.html", "Write the map with pictures, beside the published networks.")
@output_option("picture", "P.png", "Write its pictures alone.")
@click.pass_obj
def map_(progress: Progress, campaign: Path, out: Path, report_file: Path | None, picture_file: Path | None) -> int:
    """Fit the cueing map: what a commanded stroke gives the ball.

    Reads the shots of `robot campaign`, and writes the map with its uncertainty.

    Example: robot map shots.csv --out map.toml
    """
    import numpy as np

    from models.analytic.cue_impulse import CONSTANT_NAMES
    from planner.launcher.cueing_map import write_map
    from robot.cueing.campaign import read_campaign
    from robot.cueing.map_fit import fit_map

    shots = read_campaign(campaign)
    made = fit_map(shots)
    write_map(out, made)
    sds = np.sqrt(np.diag(made.covariance))
    rows = [("constant", "value", "sd")]
    rows += [(n, f"{getattr(made.constants, n):.6g}", f"{sd:.2g}") for n, sd in zip(CONSTANT_NAMES, sds, strict=True)]
    print(table(rows))
    print(f"map: {out} ({made.shots} shots, {made.left_out} left out, chi2 {made.chi2_reduced:.2f})")
    if report_file or picture_file:
        from robot.cueing.held_out import compare_maps
        from robot.cueing.report import write_picture, write_report

        progress("training the networks that it is compared with")
        contest = compare_maps(shots, np.random.default_rng(0))
        progress.close()
        if report_file:
            write_report(report_file, f"Cueing map: {campaign.name}", shots, contest)
            print(f"report: {report_file}")
        if picture_file:
            write_picture(picture_file, shots, contest)
            print(f"picture: {picture_file}")
    return Status.DONE


@click.command(cls=StringsCommand)
@settings_option
@strings_option("15 over the launcher's speeds")
@repeats_option(20)
@seed_option()
@json_option
@click.pass_obj
def repeat(
    progress: Progress, settings_file: Path | None, strings: tuple[int, ...], repeats: int, seed: int,
    json_file: Path | None,
) -> int:  # fmt: skip
    """Repeat strokes of each string: how far apart the balls stop.

    Plays on the emulated launcher, on a snooker table and on an unlimited cloth.

    Example: robot repeat --strings 60 160 --repeats 5
    """
    from models.mjcf.snooker import SNOOKER_TABLE
    from robot.emulator.repeatability import OPEN_CLOTH, Conditions, measure, result, spread_strings, text

    settings = Wire(settings_file=settings_file).settings()
    chosen = list(strings) or spread_strings(settings)
    on_table, on_cloth = [
        measure(settings, chosen, repeats, seed, Conditions(cloth), progress) for cloth in (SNOOKER_TABLE, OPEN_CLOTH)
    ]
    progress.close()
    print(f"snooker table\n{text(on_table)}\n\nunlimited cloth\n{text(on_cloth)}\n")
    if json_file:
        write_json(json_file, result(on_table, on_cloth, seed))
    return Status.DONE


@click.command(cls=StringsCommand)
@out_option("NEW.toml", "Where the new launcher's file goes.")
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
    """Calibrate the strings: the cue speed of each, as measured.

    Strikes without a ball, and writes a launcher's file with the speeds. Without --port on the emulated launcher.

    Example: robot calibrate --port /dev/ttyUSB0 --out launcher.toml
    """
    import numpy as np

    from robot.device.calibrate import CALIBRATION_STRINGS, measure_strings, result, text, write_calibration
    from robot.emulator.table import emulated_launcher

    settings, chosen = wire.settings(), list(strings) or list(CALIBRATION_STRINGS)
    if wire.port:
        action = f"{repeats * len(chosen)} times without a pause, {repeats} of each of {chosen}"
        if not yes and not confirmed(action, "take the ball away"):
            raise BadInput("not confirmed; nothing was struck, say yes to strike")
        launcher = wire.launcher(settings)
    else:
        print("no --port: on the emulated launcher, whose strings run as the settings say")
        launcher = emulated_launcher(settings, lambda *_: None, np.random.default_rng(seed), log=wire.log)[0]
    with launcher:
        measured = measure_strings(launcher, chosen, repeats, progress)
    progress.close()
    print(text(measured, settings))  # before the file: speeds that do not fall are refused, but shown
    write_calibration(wire.settings_file, measured, out)
    print(f"launcher's file: {out}")
    if json_file:
        write_json(json_file, result(measured))
    return Status.DONE
