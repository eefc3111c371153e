"""Verbs of the `robot` command that measure the launcher: its cueing map, how well it repeats, its strings' speeds."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from models.console import DONE, Progress, Verb, check_outputs, table, write_json
from models.errors import BadInput
from robot.cli.common import confirmed, launcher_at, seed_of, seeded, settings_of, wired


def add(verb: Verb) -> None:
    """The verbs with their options."""
    one = verb("campaign", campaign, "the paper's grid of strokes on the emulated launcher, begun or gone on with")
    one.add_argument("out", metavar="OUT.csv", help="shots, a row each")
    one.add_argument("--most", metavar="N", type=int, help="stop after so many more shots")
    seeded(one, 1)
    one = verb("map", fit, "the cueing map of a campaign: what a told stroke gives the ball")
    one.add_argument("campaign", metavar="CSV", help="of robot campaign")
    one.add_argument("--out", metavar="MAP.toml", required=True, help="map to write; planner plan --map reads it")
    one.add_argument("--report", metavar="H.html", help="the map on paper, with its errors on strokes held out")
    one.add_argument("--picture", metavar="P.png", help="its pictures alone")
    one = verb("repeat", repeat, "how far apart strokes of one string end, on the emulated launcher and table")
    one.add_argument("--settings", metavar="L.toml", help="launcher's file (default: the paper's launcher)")
    one.add_argument("--strings", metavar="N", type=int, nargs="+", help="default: 15 over the launcher's speeds")
    one.add_argument("--repeats", metavar="N", type=int, default=20, help="of each (default: 20)")
    seeded(one, 0)
    one.add_argument("--json", metavar="FILE", help="the same figures")
    text = "what cue speed each string gives, as the launcher measures it; without --port on the emulated one"
    one = verb("calibrate", calibrate, text)
    one.add_argument("--out", metavar="NEW.toml", required=True, help="launcher's file to write")
    wired(one, required=False)
    one.add_argument("--strings", metavar="N", type=int, nargs="+", help="to be measured (default: 9 of the 200)")
    one.add_argument("--repeats", metavar="N", type=int, default=5, help="of each (default: 5)")
    seeded(one, 0)
    one.add_argument("--yes", action="store_true", help="strike without asking; look that nothing is in the way first")
    one.add_argument("--json", metavar="FILE", help="the same figures")


def campaign(args: argparse.Namespace, progress: Progress) -> int:
    """Play the paper's campaign with the emulated launcher, on and on into one file."""
    from models.mjcf.gl import choose_backend

    choose_backend()
    from robot.cueing.campaign import count_played, run_campaign
    from robot.cueing.striker import EmulatedStriker, Sloppiness, draw_hidden

    check_outputs(args.out)
    if args.most is not None and args.most < 1:
        raise BadInput(f"--most {args.most}: give 1 or more")
    print("on the emulated launcher, with constants drawn from the seed")
    hidden = draw_hidden(np.random.default_rng(seed_of(args)))
    striker = EmulatedStriker(hidden, Sloppiness(), args.seed, count_played(args.out))
    shots = run_campaign(striker, args.out, args.seed, progress, most=args.most)
    progress.close()
    print(f"{len(shots)} shots, {sum(s.miscue for s in shots)} miscues: {args.out}")
    return DONE


def fit(args: argparse.Namespace, progress: Progress) -> int:
    """Fit the cueing map to a campaign; a report or a picture shows its errors on strokes held out."""
    from models.analytic.cue_impulse import NAMES
    from planner.launcher.cueing_map import write_map
    from robot.cueing.campaign import read_campaign
    from robot.cueing.map_fit import fit_map

    check_outputs(args.out, args.report, args.picture)
    shots = read_campaign(args.campaign)
    made = fit_map(shots)
    write_map(args.out, made)
    sds = np.sqrt(np.diag(made.covariance))
    rows = [("constant", "value", "sd")]
    rows += [(n, f"{getattr(made.constants, n):.6g}", f"{sd:.2g}") for n, sd in zip(NAMES, sds, strict=True)]
    print(table(rows))
    print(f"map: {args.out} ({made.shots} shots, {made.left_out} left out, chi2 {made.chi2_reduced:.2f})")
    if args.report or args.picture:
        from robot.cueing.held_out import compare_maps
        from robot.cueing.report import write_picture, write_report

        progress("fitting without the strokes held out")
        contest = compare_maps(shots, np.random.default_rng(0))
        progress.close()
        if args.report:
            write_report(args.report, f"Cueing map: {Path(args.campaign).name}", shots, contest)
            print(f"report: {args.report}")
        if args.picture:
            write_picture(args.picture, shots, contest)
            print(f"picture: {args.picture}")
    return DONE


def repeat(args: argparse.Namespace, progress: Progress) -> int:
    """Strike every string again and again, on a snooker table and on a cloth without end."""
    from models.mjcf.snooker import SNOOKER_TABLE
    from robot.emulator.repeatability import OPEN_CLOTH, Conditions, measure, result, spread_strings, text

    seed, settings = seed_of(args), settings_of(args)
    check_outputs(args.json)
    strings = args.strings or spread_strings(settings)
    both = [
        measure(settings, strings, args.repeats, seed, Conditions(cloth), progress)
        for cloth in (SNOOKER_TABLE, OPEN_CLOTH)
    ]
    progress.close()
    for name, got in zip(("snooker table", "cloth without end"), both, strict=True):
        print(f"{name}\n{text(got)}\n")
    if args.json:
        write_json(args.json, result(both[0], both[1], seed))
    return DONE


def calibrate(args: argparse.Namespace, progress: Progress) -> int:
    """Measure what cue speed each string gives, and write a launcher's file with it."""
    from robot.device.calibrate import CALIBRATION_STRINGS, measure_strings, result, text, write_calibration
    from robot.emulator.table import emulated_launcher

    seed, settings, strings = seed_of(args), settings_of(args), args.strings or list(CALIBRATION_STRINGS)
    check_outputs(args.out, args.json)
    if args.port:
        told = f"{args.repeats * len(strings)} times without a pause, {args.repeats} of each of {strings}"
        if not args.yes and not confirmed(told, "take the ball away"):
            raise BadInput("not confirmed; nothing was struck, say yes to strike")
        launcher = launcher_at(args, settings)
    else:
        print("no --port: on the emulated launcher, whose strings run as the settings say")
        launcher = emulated_launcher(settings, lambda *_: None, np.random.default_rng(seed), log=args.log)[0]
    with launcher:
        measured = measure_strings(launcher, strings, args.repeats, progress)
    progress.close()
    print(text(measured, settings))  # before the file: a table that does not fall is refused, its strokes are made
    write_calibration(args.settings, measured, args.out)
    print(f"launcher's file: {args.out}")
    if args.json:
        write_json(args.json, result(measured))
    return DONE
