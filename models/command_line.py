"""Common parts of the commands: verbs in sections, types and decorators of options, faults as one line on stderr.

A verb is a typed function with its options as decorators; what it returns is the exit status. A `Program` lists its
verbs by section, and `run` runs one of them. Options that several verbs share are one decorator each.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import importlib.metadata
import math
import os
import platform
import re
import select
import shlex
import signal
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence, Set
from pathlib import Path
from typing import Any, TypeVar

import click

from models.command_outputs import (
    EFFECTS_KEY,
    JsonFile,
    OutputFile,
    ResultFile,
    ResultFolder,
    has_result,
    keeping_results,
    overwrite_option,
)
from models.console import Progress, Status, as_called, named, show_progress
from models.errors import BadInput, one_line
from models.files.limits import MAX_PICTURE_PIXELS
from models.files.writing import NO_ROOM, unwritable
from models.interrupts import SIGNAL_STATUS, Terminated, as_interrupts

Verb = TypeVar("Verb", bound=Callable[..., Any])
FILE_PATH = click.Path(path_type=Path)
HELP_COLUMNS = 110  # largest width of help texts
HELP_SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": HELP_COLUMNS}


WORDS_KEY = "cuelab.words"  # of a click context: the command line
OUTPUT_FILE, RESULT_FILE = OutputFile(), ResultFile()


@dataclasses.dataclass(frozen=True)
class Number(click.ParamType[float, str]):
    """A number within bounds; `above` excludes the lower one, `whole` asks for an integer."""

    low: float = -math.inf
    high: float = math.inf
    whole: bool = False
    above: bool = False
    unit: str = ""

    @property
    def name(self) -> str:  # type: ignore[override]
        """The name in help texts."""
        return "integer" if self.whole else "number"

    def convert(self, value: str | float, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Check the bounds; BadInput names the option, its value and the bounds."""
        option = param.opts[0] if param else "value"
        try:
            number = int(value) if self.whole else float(value)
        except ValueError:
            number = math.nan
        inside = self.low < number if self.above else self.low <= number
        if not inside or not number <= self.high or (math.isinf(number) and math.isinf(self.high)):
            raise BadInput(f"{option} {value}: give a{' whole' * self.whole} number{self._bounds()}")
        return number

    def _bounds(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        if math.isinf(self.low):
            return unit
        if math.isinf(self.high):
            return f" above {self.low:g}{unit}" if self.above else f" of {self.low:g}{unit} or more"
        return f" from {self.low:g} to {self.high:g}{unit}"


NON_NEGATIVE = Number(0, whole=True)
ABOVE_ZERO = Number(0, above=True)
ZERO_OR_MORE = Number(0)
ANY_NUMBER = Number()

json_option = click.option(
    "--json", "json_file", metavar="FILE", type=JsonFile(), help="Write the figures as JSON; - for standard output."
)


def out_option(metavar: str, text: str, **more: Any) -> Callable[[Verb], Verb]:
    """The option of a verb's main output file."""
    return click.option("--out", metavar=metavar, type=RESULT_FILE, help=text, **{"required": True} | more)


def out_folder_option(text: str, *writes: str, joined: Sequence[str] = (), **more: Any) -> Callable[[Verb], Verb]:
    """The option of a verb's main output folder, with patterns of the files written there (`ResultFolder`)."""
    kind = ResultFolder(*writes, joined=joined)
    return click.option("--out", metavar="DIR", type=kind, help=text, **{"required": True} | more)


def output_option(name: str, metavar: str, text: str) -> Callable[[Verb], Verb]:
    """The option of an additional output file: `--report` gives the parameter `report_file`."""
    return click.option(f"--{name}", f"{name}_file", metavar=metavar, type=OUTPUT_FILE, help=text)


def input_option(name: str, metavar: str, text: str, **more: Any) -> Callable[[Verb], Verb]:
    """The option of an input file: `--model` gives the parameter `model_file`."""
    return click.option(f"--{name}", f"{name}_file", metavar=metavar, type=FILE_PATH, help=text, **more)


def seed_option(default: int = 0) -> Callable[[Verb], Verb]:
    """The option of the seed of all random numbers."""
    text = "Seed of the random numbers."
    return click.option("--seed", metavar="N", type=NON_NEGATIVE, default=default, show_default=True, help=text)


scheduler_option = click.option(
    "--scheduler", metavar="ADDRESS",
    help="Address of a Dask scheduler whose workers compute (docs/cluster.md); by default this machine computes.",
)  # fmt: skip


def effects_option(*, exposed: bool = False) -> Callable[[Verb], Verb]:
    """The option of the user's own effects, which join the catalogue first; the verb gets the folders if `exposed`."""
    text = "Folder, or file, with your own effects; may be given more than once."
    return click.option(
        "--effects", "effect_folders", metavar="DIR", multiple=True, callback=_add_effects, expose_value=exposed,
        help=text,
    )  # fmt: skip


def _add_effects(ctx: click.Context, param: click.Parameter, folders: tuple[str, ...]) -> tuple[str, ...]:
    if folders and not ctx.resilient_parsing:
        from models.model_file import add_folder

        ctx.meta[EFFECTS_KEY] = [Path(folder) for folder in folders]
        for folder in folders:
            add_folder(folder)
    return folders


def given(
    option: str | Callable[[Any], Any], metavar: str = "", text: str = "", kind: Any = str, default: Any = None,
    **more: Any,
) -> Any:  # fmt: skip
    """A dataclass field filled by an option: a shared one, or one from flag, metavar, help, type and default."""
    shown = {"metavar": metavar or None, "help": text, "show_default": kind is not bool}
    if default is not None:  # a required option must have no default
        shown["default"] = default
    return dataclasses.field(default=default, metadata={"option": (option, kind, shown | more)})


def gathered(name: str, kind: type) -> Callable[[Verb], Verb]:
    """A group of options: a verb gets them under this name, as one value of a dataclass of `given` fields."""
    options: dict[str, Callable[[Any], Any]] = {}
    for field in dataclasses.fields(kind):
        option, type_, shown = field.metadata["option"]
        if isinstance(option, str):
            typed = {"is_flag": True} if type_ is bool else {"type": type_}
            option = click.option(option, field.name, **typed, **shown)
        options[field.name] = option

    def decorate(verb: Verb) -> Verb:
        @functools.wraps(verb)
        def call(*words: Any, **named: Any) -> Any:
            return verb(*words, **{name: kind(**{field: named.pop(field) for field in options})}, **named)

        decorated: Any = call
        for option in reversed(options.values()):
            decorated = option(decorated)
        return decorated

    return decorate


def at_most_one(**given: object) -> None:
    """Raise BadInput for options that exclude each other, named by their parameters."""
    named = [f"--{name.replace('_', '-')}" for name, value in given.items() if value]
    if len(named) > 1:
        raise BadInput(f"{' and '.join(named)} exclude each other; give one of them")


def lone_command(name: str) -> Callable[[Callable[..., Any]], click.Command]:
    """The decorator of a command that a module runs with `python -m`."""
    return click.command(name, context_settings=HELP_SETTINGS)


def _print_versions(ctx: click.Context, param: click.Parameter, asked: bool) -> None:
    """The versions that results depend on."""
    if not asked or ctx.resilient_parsing:
        return
    found = [f"Python {platform.python_version()}"]
    for name in ("cuelab", *VERSIONS_OF):
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            found.append(f"{name} {importlib.metadata.version(name)}")
    click.echo(f"{ctx.info_name}: {', '.join(found)}")
    ctx.exit()


VERSIONS_OF = ("mujoco", "numpy", "scipy", "numba", "opencv-python-headless", "rerun-sdk")
VERSION_OPTION = click.Option(
    ["--version"], is_flag=True, is_eager=True, expose_value=False, callback=_print_versions, help="Print versions."
)


def _be_quiet(ctx: click.Context, param: click.Parameter, asked: bool) -> None:
    """Silence the progress of a command."""
    if asked and isinstance(ctx.obj, Progress):
        ctx.obj.quiet = True


QUIET_OPTION = click.Option(["--quiet"], is_flag=True, expose_value=False, callback=_be_quiet, help="Show no progress.")


class Program(click.Group):
    """A command whose help lists the verbs by section, in the order of use."""

    def __init__(self, name: str, text: str, sections: Mapping[str, Sequence[click.Command]]) -> None:
        """Create the command from its verbs."""
        verbs = {str(verb.name): verb for section in sections.values() for verb in section}
        for verb in verbs.values():
            if QUIET_OPTION in verb.params:
                continue
            if has_result(verb):
                verb.params.append(overwrite_option())
            verb.params.append(QUIET_OPTION)
            verb.callback = keeping_results(verb)
        asked = f"_{name.upper()}_COMPLETE"
        epilog = (
            f'Tab completion, with .venv/bin on the PATH: eval "$({asked}=bash_source {name})" in bash, zsh_source in '
            f"zsh; in fish {asked}=fish_source {name} | source."
        )
        super().__init__(
            name, help=text, epilog=epilog, commands=verbs, context_settings=HELP_SETTINGS, no_args_is_help=False,
            subcommand_metavar="VERB [OPTIONS]", options_metavar="", params=[VERSION_OPTION],
        )  # fmt: skip
        self.sections = sections

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write a help line for each verb."""
        width = max(map(len, self.commands))
        for title, verbs in self.sections.items():
            with formatter.section(title):
                formatter.write_dl([(str(v.name).ljust(width), v.get_short_help_str(HELP_COLUMNS)) for v in verbs])


def run(
    program: click.Command,
    words: Sequence[str] | None = None,
    *,
    interrupted: str = "",
    failures: tuple[type[Exception], ...] = (),
) -> int:
    """Run a command, or the named verb of a program; returns the exit status.

    Args:
        words: the command line without the program's name; by default those of the process.
        interrupted: text on files or devices for the message after an interrupt; notes of the exception follow it.
        failures: exceptions that are findings for the user, with status 1.
    """
    _prepare_process(own=words is None)
    name = str(program.name)
    if f"_{name.upper()}_COMPLETE" in os.environ:
        program.main(prog_name=name)  # writes the completions for the shell, and exits
    words = list(sys.argv[1:] if words is None else words)
    verbs = list(program.commands) if isinstance(program, click.Group) else []
    path = f"{name} {words[0]}" if words and words[0] in verbs else name
    started = name if verbs else f"python -m {name}"
    progress = show_progress()
    reported: tuple[type[Exception], ...] = (BadInput, *failures)
    status, fault, more = int(Status.DONE), "", list[str]()
    try:
        with as_interrupts(), program.make_context(started, words, obj=progress) as context:
            context.meta[WORDS_KEY] = (name, *words)
            status = program.invoke(context)
            sys.stdout.flush()
    except click.exceptions.Exit as end:
        status = Status(end.exit_code)
    except click.ClickException as error:
        status, fault = Status.BAD_INPUT, _usage_fault(error, path, verbs, words)
    except reported as error:
        status, fault = Status.BAD_INPUT if isinstance(error, BadInput) else Status.FINDING, str(error)
        more = getattr(error, "__notes__", more)  # further faults of a file
    except KeyboardInterrupt as stop:
        status = SIGNAL_STATUS + (stop.number if isinstance(stop, Terminated) else signal.SIGINT)
        fault = "; ".join([f"interrupted{interrupted}", *getattr(stop, "__notes__", ())])  # on kept results
    except BrokenPipeError:
        if not _reader_left():
            raise
        status = Status.BROKEN_PIPE
    except OSError as error:  # a full disk, a file that disappeared
        where = error.filename or "standard output"
        text = f"{where}: {error.strerror or error}; check the disk and access rights"
        status, fault = Status.BAD_INPUT, str(unwritable(where, error)) if error.errno in NO_ROOM else text
    except MemoryError:
        status, fault = Status.BAD_INPUT, "out of memory; give less input at a time"
    if not _flushed():
        status = status or Status.BAD_INPUT
    if fault:
        with contextlib.suppress(OSError):  # stderr is closed: only the status remains
            progress.close()
            for line in (fault, *more):
                print(one_line(f"{path}: {line}"), file=sys.stderr)
    return status


def typed_again(*more: str, without: Mapping[str, int]) -> str:
    """The command line that was typed, with other options, as it can be pasted.

    Args:
        more: words that are added, those of an option together.
        without: options that are left out, with how many words follow each.
    """
    typed: Sequence[str] = click.get_current_context().meta.get(WORDS_KEY, ())
    words, skipped = list[str](), 0
    for word in typed:
        option, joined, _ = word.partition("=")
        if skipped:
            skipped -= 1
        elif option in without:
            skipped = 0 if joined else without[option]
        else:
            words.append(word)
    return as_called(shlex.join([*words, *more]))


def _prepare_process(own: bool) -> None:
    """Set up environment and streams of a command, and warnings in its `own` process; before NumPy is imported."""
    # Matrices are small here, so that threads of linear algebra would only slow things down.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # OpenCV and FFmpeg: our own messages name unreadable files, and no picture may fill the memory.
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")
    os.environ.setdefault("OPENCV_FFMPEG_LOGLEVEL", "-8")
    os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(MAX_PICTURE_PIXELS))
    if own and not sys.warnoptions:  # our own messages report bad input
        warnings.simplefilter("ignore", RuntimeWarning)
    for stream in ("stdout", "stderr"):  # a stream closed by the shell is discarded
        if getattr(sys, stream) is None:
            setattr(sys, stream, open(os.devnull, "w", encoding="utf-8"))  # noqa: SIM115


def _usage_fault(error: click.ClickException, path: str, verbs: Sequence[str], words: Sequence[str]) -> str:
    """The message on a wrong word or option, in one line, with similar ones."""
    if verbs and "Missing command" in error.format_message():
        return f"no verb was given; choose one of {', '.join(verbs)}"
    if isinstance(error, click.MissingParameter) and error.ctx is not None:
        return _missing(error, error.ctx, path, {word.partition("=")[0] for word in words})
    text = " ".join(error.format_message().split()).rstrip(".")
    return f"{text[:1].lower()}{text[1:]}" + ("" if text.endswith("?") else f"; see {path} --help")


def _missing(error: click.MissingParameter, context: click.Context, path: str, words: Set[str]) -> str:
    """The message on what a verb needs and was not given, all of it, with the example of its help."""
    absent = []
    for one in context.command.params:
        if isinstance(one, click.Option) and one.required and not words & set(one.opts):
            absent.append(f"{one.opts[0]} {one.metavar or ''}".rstrip())
        elif isinstance(one, click.Argument) and one is error.param:
            absent.insert(0, one.make_metavar(context))
    example = re.search(r"Example: (.*)", context.command.help or "")
    remedy = f"give it as in: {as_called(example[1].strip())}" if example else f"see {path} --help"
    return f"missing {named(absent)}; {remedy}"


def _flushed() -> bool:
    """Flush all output; returns whether that worked, and else discards the rest, so that the interpreter is quiet."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return False
    return True


def _reader_left() -> bool:
    """Whether standard output was closed, as by `| head`; further output is then discarded."""
    output = select.poll()
    output.register(sys.stdout.fileno(), 0)
    if not any(event & select.POLLERR for _, event in output.poll(0)):
        return False
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or the interpreter would complain at its end
    return True
