"""`sysid match`: MuJoCo and the event engine against the analytic models and published measurements."""

from __future__ import annotations

import argparse

from models.console import DONE, FOUND, Progress, Verb, check_outputs, print_constants, write_json


def register(verb: Verb) -> None:
    """The verb with its options."""
    one = verb("match", match, "MuJoCo against the analytic models and published measurements, row by row")
    way = one.add_mutually_exclusive_group()
    way.add_argument("--json", metavar="FILE", help="the rows as JSON")
    way.add_argument("--tune", metavar="M.toml", help="instead, fit the native MJCF's terms to the analytic models")
    way.add_argument("--clips", metavar="DIR", help="instead, write shots of the analytic models as clips to fit to")


def match(args: argparse.Namespace, progress: Progress) -> int:
    """MuJoCo against the analytic models and published measurements."""
    check_outputs(args.json, args.tune)
    if args.tune is not None:
        from models.model_file import write_model
        from sysid.validation.native_fit import tuned

        model = tuned(progress)
        progress.close()
        print_constants(model)
        write_model(model, args.tune)
        print(f"\nmodel: {args.tune}")
        return DONE
    if args.clips is not None:
        from sysid.validation.clips import write_clips

        write_clips(args.clips)
        print(f"{args.clips}: clips of the analytic models, and native.toml to start a fit of MuJoCo's contacts from")
        return DONE
    from sysid.validation import match as room

    found = []
    for row in room.rows():
        progress.close()
        found.append(row)
        print(room.line(row), flush=True)
        progress("the next rows")
    progress.close()
    missed = [row for row in found if not row.ok]
    limited = sum(row.tolerance is not None for row in found)
    print(f"\n{len(found)} rows, {limited} with a tolerance, {len(missed)} exceed it")
    if args.json:
        write_json(args.json, {"rows": [room.to_json(row) for row in found]})
    return FOUND if missed else DONE
