"""Outputs of verbs: types of their options, and the rule that no result is replaced without --overwrite.

A result is a verb's main output (`ResultFile`, `ResultFolder`): only the same verb with the same options and inputs
replaces it (models/files/made.py). Additional pictures, reports, figures and recordings (`OutputFile`) can be made
again: they replace files of their own kind. Only a result may replace an input of the verb.
"""

from __future__ import annotations

import contextlib
import functools
import os
import sys
import uuid
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import click

from models.commands.console import OUTPUT_KEY, STANDARD_OUTPUT
from models.errors import BadInput

OVERWRITE_KEY, EFFECTS_KEY = "cuelab.overwrite", "cuelab.effects"  # keys of the click context
# Options that do not change a result, or name additional outputs.
WITHOUT_EFFECT = {"jobs", "scheduler", "live", "web", "yes", "log", "films", "accept_camera", "preview"}
PORT_OPTION = "port"  # of a launcher: a measurement there cannot be made again


class OutputFile(click.ParamType[Path, str]):
    """A file to write, which is checked before the work starts."""

    name = "file"

    def convert(self, value: str | Path, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Check that its folder exists."""
        path = Path(value)
        if not path.resolve().parent.is_dir():
            raise BadInput(f"{path}: its folder does not exist; create it or choose another place")
        if path.is_dir():
            raise BadInput(f"{path}: is a folder; name a file")
        return path


class JsonFile(OutputFile):
    """A file to write, or - for standard output; tables then go to standard error."""

    def convert(self, value: str | Path, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Check that its folder exists, or reserve standard output."""
        if str(value) != STANDARD_OUTPUT or ctx is None:
            return super().convert(value, param, ctx)
        if OUTPUT_KEY not in ctx.meta:
            ctx.meta[OUTPUT_KEY] = sys.stdout
            ctx.with_resource(contextlib.redirect_stdout(sys.stderr))
        return Path(STANDARD_OUTPUT)


class ResultFile(OutputFile):
    """The main output file of a verb."""


class ResultFolder(click.ParamType[Path, str]):
    """The main output folder of a verb.

    Args:
        writes: patterns of the files written there; a folder without any of these is accepted.
        joined: parameters whose results are added to existing ones, so that they may differ.
    """

    name = "path"

    def __init__(self, *writes: str, joined: Sequence[str] = ()) -> None:
        """Create the type; nothing is checked yet."""
        self.writes, self.joined = writes, joined

    def convert(self, value: str | Path, param: click.Parameter | None, ctx: click.Context | None) -> Path:
        """Any path, whether it exists or not."""
        return Path(value)


def _note_overwrite(ctx: click.Context, param: click.Parameter, asked: bool) -> None:
    ctx.meta[OVERWRITE_KEY] = asked


def overwrite_option() -> click.Option:
    """The option --overwrite, which every verb with a result has."""
    return click.Option(
        ["--overwrite"], is_flag=True, expose_value=False, callback=_note_overwrite,
        help="Replace a result of another command or other input.",
    )  # fmt: skip


def has_result(verb: click.Command) -> bool:
    """Whether a verb has a main output."""
    return any(isinstance(param.type, ResultFile | ResultFolder) for param in verb.params)


def keeping_results(verb: click.Command) -> Callable[..., Any] | None:
    """The verb's function with a check that its outputs replace nothing that they should not."""
    inner = verb.callback
    if inner is None:
        return None

    @functools.wraps(inner)
    def call(*words: Any, **named: Any) -> Any:
        with _checked(click.get_current_context()):
            return inner(*words, **named)

    return call


@contextlib.contextmanager
def _checked(ctx: click.Context) -> Iterator[None]:
    """Within this context results are marked with their origin; BadInput if one would replace a foreign file."""
    given = [(param, ctx.params.get(str(param.name))) for param in ctx.command.params]
    outputs = [(p, v) for p, v in given if isinstance(p.type, OutputFile) and isinstance(v, Path)]
    results = [v for p, v in outputs if isinstance(p.type, ResultFile)]
    folders = [(p.type, v) for p, v in given if isinstance(p.type, ResultFolder) and isinstance(v, Path)]
    read = {place for p, v in given for path in _paths(p, v) if (place := _real(path))}
    for param, path in outputs:
        if not isinstance(param.type, ResultFile):
            _check_beside(param, path, read)
    if not results and not folders:
        yield
        return
    from models.files.made import check_file, check_folder, digest, marked, without_lone_record
    from models.files.record import Origin

    joined = {name for kind, _ in folders for name in kind.joined}
    values = [(p.name, v) for p, v in given if _counts(p) and p.name not in joined]
    once = [uuid.uuid4().hex] if ctx.params.get(PORT_OPTION) else []
    command = ctx.command_path.replace("python -m ", "")
    origin = Origin(command, digest([command, *sorted(values, key=str), ctx.meta.get(EFFECTS_KEY, ()), *once]))
    if not ctx.meta.get(OVERWRITE_KEY):
        for path in results:
            check_file(path, origin)
        for kind, path in folders:
            check_folder(path, kind.writes, origin)
    with without_lone_record([path for _, path in folders]), marked(origin, [*results, *(path for _, path in folders)]):
        yield


def _real(path: Path) -> str:
    """The real path; "" for an invalid file name."""
    try:
        return os.path.realpath(path)
    except (OSError, ValueError):
        return ""


def _counts(param: click.Parameter) -> bool:
    """Whether a parameter is part of a result's origin."""
    return not isinstance(param.type, OutputFile | ResultFolder) and str(param.name) not in WITHOUT_EFFECT


def _paths(param: click.Parameter, value: Any) -> list[Path]:
    """The input files named by a parameter."""
    values = value if isinstance(value, list | tuple) else [value]
    return [path for path in values if isinstance(path, Path)] if _counts(param) else []


def _check_beside(param: click.Parameter, path: Path, read: set[str]) -> None:
    """Raise BadInput if an additional output would replace an input, or a file of another kind."""
    if isinstance(param, click.Argument) or not path.is_file():  # it continues an existing file
        return
    place = Path(os.path.realpath(path))
    if read & {str(place), *map(str, place.parents)}:
        raise BadInput(f"{param.opts[0]} {path}: is an input of this command; name another file")
    named = "FILE.json" if isinstance(param.type, JsonFile) else str(param.metavar)
    kinds = [suffix for name in named.split("|") if (suffix := Path(name).suffix)]
    if kinds and path.suffix.lower() not in kinds:
        kind = " or ".join(kinds)
        text = f"{param.opts[0]} {path}: already exists and its name does not end in {kind}; name another file"
        raise BadInput(text)
