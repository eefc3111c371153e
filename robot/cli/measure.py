"""Verbs that measure the launcher: its cueing map, its repeatability, and the speeds of its strings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from models.commands.console import Progress, Status, table, write_json
from models.commands.options import (
    FILE_PATH,
    OUTPUT_FILE,
    Number,
    gathered,
    input_option,
    json_option,
    out_option,
    output_option,
    seed_option,
)
from models.errors import BadInput
from models.files import alone_in
from models.messages import counted
from robot.cli.common import Filming, Wire, confirmed, yes_option
from robot.cli.single_ball import AtTable
from robot.device.protocol import LauncherError

if TYPE_CHECKING:
    from robot.cueing.campaign import Striker

SLIDE_FRICTION = "decoupled_cloth.slide"  # the sliding friction among a model's parameters


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


@click.command()
@click.argument("out", metavar="OUT.csv", type=OUTPUT_FILE)
@click.option("--most", metavar="N", type=Number(1, whole=True), help="Stop after N more shots.")
@seed_option(1)
@gathered("wire", Wire)
@gathered("filming", Filming)
@gathered("at_table", AtTable)
@input_option("model", "M.toml", "Model of the real table, for its cloth's friction; by default the base's.")
@click.pass_obj
def campaign(
    progress: Progress, out: Path, most: int | None, seed: int, wire: Wire, filming: Filming, at_table: AtTable,
    model_file: Path | None,
) -> int:  # fmt: skip
    """Play the published grid of strokes, and measure speed and direction of the ball.

    Writes a row for each shot into OUT.csv; an existing file is continued. With --port and a camera it runs at a table,
    where a person puts the ball back for every stroke; without, on the emulated launcher.

    Example: robot campaign shots.csv
    """
    from robot.cueing.campaign import count_played, run_campaign

    click.get_current_context().with_resource(alone_in(out))
    try:
        with _striker(progress, out, most, seed, wire, filming, at_table, model_file) as striker:
            shots = run_campaign(striker, out, seed, progress, most=most)
    except (KeyboardInterrupt, BadInput, LauncherError) as end:
        if played := count_played(out):
            end.add_note(f"{played} shots are kept in {out}: the same command continues from there")
        raise
    progress.close()
    print(f"{counted(len(shots), 'shot')}, {counted(sum(s.miscue for s in shots), 'miscue')}: {out}")
    return Status.DONE


@contextmanager
def _striker(
    progress: Progress, out: Path, most: int | None, seed: int, wire: Wire, filming: Filming, at_table: AtTable,
    model_file: Path | None,
) -> Iterator[Striker]:  # fmt: skip
    """The striker of a campaign: the launcher at its port, or the emulated one."""
    import numpy as np

    from models.mjcf.gl import choose_backend
    from models.model_file import full_model, read_model
    from robot.cueing.campaign import count_played, make_grid

    played, grid = count_played(out), make_grid()
    if not wire.port:
        wire.refuse("settings_file", "log")
        filming.refuse()
        at_table.refuse()
        if model_file:
            raise BadInput("--model requires a launcher at a --port; omit it, or name the port")
        choose_backend()
        from robot.cueing.striker import EmulatedStriker, Sloppiness, draw_hidden

        print("no --port: using the emulated launcher, with constants drawn from the seed")
        yield EmulatedStriker(draw_hidden(np.random.default_rng(seed)), Sloppiness(), seed, played)
        return
    from robot.table.strokes import TableStriker, check_strokes

    filming.require("a campaign")
    settings = wire.settings()
    model = read_model(model_file) if model_file else None
    with at_table.ball(wire, filming, settings) as rig:
        model = model or full_model(rig.table, rig.ball)
        if (model.table, model.ball) != (rig.table, rig.ball):
            raise BadInput(f"{model_file}: its table or ball differs from {filming.camera_file}; name another")
        if SLIDE_FRICTION not in model.parameters():
            raise BadInput(f"{model_file}: has no {SLIDE_FRICTION}; name a model based on the base")
        check_strokes(settings, grid, rig)
        last = min(len(grid), played + (most or len(grid)))
        at_table.print_needs(wire, filming, rig, last - played)
        progress.close()
        yield TableStriker(rig, float(model.parameters()[SLIDE_FRICTION]), played, last)


@click.command("map")
@click.argument("campaign", metavar="CSV", type=FILE_PATH)
@out_option("MAP.toml", "File for the map, to be used by planner plan --map.")
@output_option("report", "H.html", "Write the map with pictures, and its errors on held-out strokes.")
@output_option("picture", "P.png", "Write only its pictures.")
@input_option("model", "M.toml", "Model with the balls that were struck; by default snooker balls.")
@click.pass_obj
def map_(
    progress: Progress, campaign: Path, out: Path, report_file: Path | None, picture_file: Path | None,
    model_file: Path | None,
) -> int:  # fmt: skip
    """Fit the cueing map, from commanded strokes to the ball's speed and direction.

    Reads the shots of `robot campaign`, and writes the map with its uncertainty.

    Example: robot map shots.csv --out map.toml
    """
    import numpy as np

    from models.analytic.cue_impulse import CONSTANT_NAMES, Geometry
    from models.model_file import read_model
    from planner.launcher.cueing_map import write_map
    from robot.cueing.campaign import read_campaign
    from robot.cueing.map_fit import fit_map

    shots = read_campaign(campaign)
    geometry = Geometry(read_model(model_file).ball) if model_file else None
    made = fit_map(shots, geometry)
    if report_file or picture_file:
        from robot.cueing.held_out import compare_maps
        from robot.cueing.report import write_picture, write_report

        progress("fitting without held-out strokes")
        contest = compare_maps(shots, np.random.default_rng(0), geometry=geometry)
        progress.close()
    write_map(out, made)
    sds = np.sqrt(np.diag(made.covariance))
    rows = [("constant", "value", "sd")]
    rows += [(n, f"{getattr(made.constants, n):.6g}", f"{sd:.2g}") for n, sd in zip(CONSTANT_NAMES, sds, strict=True)]
    print(table(rows))
    print(f"map: {out} ({made.shots} shots, {made.left_out} left out, chi2 {made.chi2_reduced:.2f})")
    if report_file:
        write_report(report_file, f"Cueing map: {campaign.name}", shots, contest)
        print(f"report: {report_file}")
    if picture_file:
        write_picture(picture_file, shots, contest)
        print(f"picture: {picture_file}")
    return Status.DONE


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
    from models.mjcf.snooker import SNOOKER_TABLE
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
