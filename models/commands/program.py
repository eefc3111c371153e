"""A program of verbs in sections, and the running of one: its exit status, and every fault as one line on stderr.

A verb is a typed function with its options as decorators (options.py); what it returns is the exit status. A `Program`
lists its verbs by section, and `run` runs one of them.
"""

from __future__ import annotations

import contextlib
import importlib.metadata
import os
import platform
import re
import select
import shlex
import signal
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence, Set
from typing import Any, TextIO

import click

from models.commands.console import Progress, Status, as_called, named, show_progress
from models.commands.outputs import has_result, keeping_results, overwrite_option
from models.errors import BadInput, one_line
from models.files.limits import MAX_PICTURE_PIXELS
from models.files.writing import NO_ROOM, unwritable
from models.interrupts import SIGNAL_STATUS, Terminated, as_interrupts

HELP_COLUMNS = 110  # largest width of help texts
HELP_SETTINGS = {"help_option_names": ["-h", "--help"], "max_content_width": HELP_COLUMNS}
WORDS_KEY = "cuelab.words"  # of a click context: the command line


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
    if not _flushed(sys.stdout):
        status = status or Status.BAD_INPUT
    if fault:
        with contextlib.suppress(OSError):  # stderr is closed: only the status remains
            progress.close()
            for line in (fault, *more):
                print(one_line(f"{path}: {line}"), file=sys.stderr)
        _flushed(sys.stderr)
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


def _flushed(stream: TextIO) -> bool:
    """Flush a stream; returns whether that worked, and else discards the rest, so that the interpreter is quiet."""
    try:
        stream.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
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
