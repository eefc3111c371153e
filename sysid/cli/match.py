"""`sysid match`: MuJoCo and the event engine against the analytic models and published measurements."""

from __future__ import annotations

from pathlib import Path

import click

from models.commands.console import Progress, Status, print_constants, write_json
from models.commands.options import FILE_PATH, RESULT_FILE, at_most_one, json_option
from models.errors import BadInput


@click.command()
@json_option
@click.option("--tune", metavar="M.toml", type=RESULT_FILE, help="Instead, fit the native MJCF to the analytic models.")
@click.option("--clips", metavar="DIR", type=FILE_PATH, help="Instead, write shots of the analytic models as clips.")
@click.pass_obj
def match(progress: Progress, json_file: Path | None, tune: Path | None, clips: Path | None) -> int:
    """Compare MuJoCo with the analytic models and published tables.

    Prints a row for each case, with its error and tolerance. With --tune it writes a model file, with --clips a clip
    set; only one of the three options may be given. Status 1 if an error exceeds its tolerance.

    Example: sysid match --json rows.json
    """
    at_most_one(json=json_file, tune=tune, clips=clips)
    if tune:
        from models.model_file import write_model
        from sysid.validation.native_fit import tuned

        model = tuned()
        progress.close()
        print_constants(model)
        write_model(model, tune)
        print(f"\nmodel: {tune}")
        return Status.DONE
    if clips:
        if clips.exists() and (not clips.is_dir() or any(clips.iterdir())):
            raise BadInput(f"{clips}: already exists; choose another folder")
        from sysid.validation.clips import write_clips

        write_clips(clips)
        print(f"{clips}: clips of the analytic models, and native.toml, from which to fit MuJoCo's contacts")
        return Status.DONE
    from sysid.validation.match import rows
    from sysid.validation.match_result import line, to_json

    found = []
    for row in rows():
        progress.close()
        found.append(row)
        print(line(row), flush=True)
        progress("the next rows")
    progress.close()
    missed = [row for row in found if not row.ok]
    limited = sum(row.tolerance is not None for row in found)
    print(f"\n{len(found)} rows, {limited} with a tolerance, {len(missed)} beyond it")
    if json_file:
        write_json(json_file, {"rows": [to_json(row) for row in found]})
    return Status.FINDING if missed else Status.DONE
