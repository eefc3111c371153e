"""Options that messages and help name exist, in a verb or a program of this project."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import click

import planner.cli.verbs
import robot.cli.verbs
import sysid.cli.verbs
from tests.architecture.source import ROOT

OPTION = re.compile(r"(?<![\w(\"'-])--[a-z][a-z-]*[a-z](?![\w-]*[=:(]?\")")
PROGRAMS = (sysid.cli.verbs.PROGRAM, planner.cli.verbs.PROGRAM, robot.cli.verbs.PROGRAM)
# Of other programs: pip, the viewer of Rerun, and styles of reports.
FOREIGN = {"--constraint", "--editable", "--version", "--help", "--ink", "--soft", "--line", "--map-low", "--name"}


def texts() -> Iterator[tuple[Path, int, str]]:
    """All texts of the source that are longer than an option."""
    for package in ("models", "sysid", "planner", "robot"):
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Constant) and isinstance(node.value, str):
                    yield path, node.lineno, node.value


def known() -> set[str]:
    """Options of all verbs, and of programs that are started as modules."""
    found = {name for one in PROGRAMS for verb in one.commands.values() for p in verb.params for name in p.opts}
    for path in ROOT.glob("*/**/*.py"):
        if path.relative_to(ROOT).parts[0] in ("models", "sysid", "planner", "robot", "tests"):
            found |= set(re.findall(r"(?:add_argument|option)\([^)]*?\"(--[a-z-]+)\"", path.read_text()))
    return found | FOREIGN


def test_options_that_are_named_exist() -> None:
    options = known()
    wrong = [
        f"{path.relative_to(ROOT)}:{line}: {option}"
        for path, line, text in texts()
        if not text.startswith("--") or " " in text
        for option in OPTION.findall(text)
        if option not in options
    ]
    assert not wrong, "\n".join(wrong)


def test_help_names_what_may_be_chosen() -> None:
    """Each value that an option takes stands in its help, or in the word for its value."""
    silent = [
        f"{program.name} {verb.name} {option.opts[0]}: {choice}"
        for program in PROGRAMS
        for verb in program.commands.values()
        for option in verb.params
        if isinstance(option, click.Option) and isinstance(option.type, click.Choice)
        for choice in map(str, option.type.choices)
        if not re.search(
            rf"(?<!\w){re.escape(choice)}(?!\w)", f"{option.help} {option.metavar or '|'.join(option.type.choices)}"
        )
    ]
    assert not silent, "\n".join(silent)
