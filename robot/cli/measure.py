"""Verbs that measure how the launcher drives the ball: a campaign of strokes, and the cueing map fitted to it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from models.commands.console import Progress, Status, table
from models.commands.options import (
    FILE_PATH,
    OUTPUT_FILE,
    Number,
    gathered,
    input_option,
    out_option,
    output_option,
    seed_option,
)
from models.errors import BadInput
from models.files import alone_in
from models.messages import counted
from robot.cli.common import Filming, Wire
from robot.cli.single_ball import AtTable
from robot.device.protocol import LauncherError

if TYPE_CHECKING:
    from robot.cueing.campaign import Striker

SLIDE_FRICTION = "decoupled_cloth.slide"  # the sliding friction among a model's parameters


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
