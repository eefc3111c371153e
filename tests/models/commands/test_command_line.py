"""What all commands share: numbers within bounds, options as one value, faults and exit statuses."""

from __future__ import annotations

import dataclasses
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import click
import pytest

from models.commands.console import table
from models.commands.options import ABOVE_ZERO, NON_NEGATIVE, OUTPUT_FILE, Number, at_most_one, gathered, given
from models.commands.program import Program, lone_command, run
from models.errors import BadInput


@dataclasses.dataclass(frozen=True)
class Pair:
    low: float = given("--low", "L", "Low.", float, 1.0)
    high: float = given("--high", "H", "High.", float, required=True)
    flag: bool = given("--flag", "", "Flag.", bool, False)


@click.command()
@gathered("pair", Pair)
@click.option("--fault", type=click.Choice(["input", "device", "stop", "pipe"]))
def play(pair: Pair, fault: str | None) -> int:
    """Play once.

    More of it.
    """
    faults: dict[str | None, type[BaseException]] = {
        "input": BadInput, "device": OSError, "stop": KeyboardInterrupt, "pipe": BrokenPipeError
    }  # fmt: skip
    if fault in faults:
        raise faults[fault]("it broke")
    print(pair)
    return int(pair.low)


PROGRAM = Program("game", "A game.", {"Section": (play,)})


def test_what_is_missing_is_asked_for_at_once(capsys: pytest.CaptureFixture[str]) -> None:
    """With the example of the verb's help."""

    @click.command()
    @click.argument("films", metavar="VIDEO...", nargs=-1, required=True)
    @click.option("--table", metavar="NAME", required=True)
    @click.option("--out", metavar="DIR", required=True)
    def examine(films: tuple[str, ...], table: str, out: str) -> None:
        """Examine.

        Example: game examine a.mp4 --table snooker --out out/a
        """

    program, shown = (
        Program("game", "A game.", {"Section": (examine,)}),
        "game examine a.mp4 --table snooker --out out/a",
    )
    for words, absent in (
        (["a.mp4"], "--table NAME, --out DIR"), (["a.mp4", "--table=x"], "--out DIR"),
        (["--table", "x", "--out", "b"], "VIDEO..."),
    ):  # fmt: skip
        assert run(program, ["examine", *words]) == 2
        assert capsys.readouterr().err == f"game examine: missing {absent}; give it as in: {shown}\n"
    assert run(PROGRAM, ["play"]) == 2
    assert capsys.readouterr().err == "game play: missing --high H; see game play --help\n"


def test_options_reach_the_verb_as_one_value(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(PROGRAM, ["play", "--high", "-2", "--flag"]) == 1
    assert capsys.readouterr().out == f"{Pair(1.0, -2.0, True)}\n"
    assert run(PROGRAM, ["play"]) == 2
    assert "--high" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "status", "line"),
    [
        (["play", "--high", "1", "--fault", "input"], 2, "game play: it broke"),
        (["play", "--high", "1", "--fault", "device"], 1, "game play: it broke"),
        (["play", "--high", "1", "--fault", "stop"], 130, "game play: interrupted; all is kept"),
        (["plya"], 2, "game: no such command 'plya'. Did you mean 'play'?"),
        ([], 2, "game: no verb was given; choose one of play"),
    ],
)
def test_faults_are_one_line(words: list[str], status: int, line: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(PROGRAM, words, interrupted="; all is kept", failures=(OSError,)) == status
    assert capsys.readouterr().err == line + "\n"


@pytest.mark.parametrize(
    ("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129), (signal.SIGQUIT, 131)]
)
def test_a_signal_ends_a_verb_in_a_line(number: int, status: int, capsys: pytest.CaptureFixture[str]) -> None:
    """Also where a compiled module that was being imported has made another exception of it."""

    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where tests run in the background

    @lone_command("wait")
    def wait() -> None:
        try:
            os.kill(os.getpid(), number)
            time.sleep(2)
        except KeyboardInterrupt as end:
            end.add_note("3 are kept")
            raise ImportError("initialization failed") from end

    try:
        assert run(wait, []) == status
    finally:
        signal.signal(signal.SIGINT, before)
    assert capsys.readouterr().err == "wait: interrupted; 3 are kept\n"


def test_an_import_that_fails_is_no_interrupt() -> None:
    @lone_command("wait")
    def wait() -> None:
        raise ImportError("no such module")

    with pytest.raises(ImportError):
        run(wait, [])


@pytest.mark.slow
def test_a_full_disk_and_closed_streams_are_told_by_the_status() -> None:
    words = [sys.executable, "-m", "sysid.cli", "effects", "squirt"]
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[3])}
    with open("/dev/full", "w") as full:
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, env=environment, text=True, check=False)
        assert done.returncode == 2 and done.stderr.splitlines() == [
            "sysid effects: standard output: cannot be written (No space left on device); make room on its disk, or "
            "choose another place"
        ]
        done = subprocess.run([*words, "none"], stderr=full, stdout=full, env=environment, check=False)
        assert done.returncode == 2
    for closed in (">&-", "2>&-", ">&- 2>&-"):
        shell = f"{sys.executable} -m sysid.cli effects squirt {closed}"
        assert (
            subprocess.run(shell, shell=True, stdout=subprocess.DEVNULL, env=environment, check=False).returncode == 0
        )


def test_help_lists_sections_and_ends_well(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(PROGRAM, ["-h"]) == 0
    text = capsys.readouterr().out
    assert "Section:" in text and "play  Play once." in text and "_GAME_COMPLETE=bash_source" in text


@pytest.mark.parametrize(
    ("kind", "good", "bad", "bounds"),
    [
        (NON_NEGATIVE, ["0", "7"], ["-1", "1.5", "x"], "a whole number of 0 or more"),
        (ABOVE_ZERO, ["1e-9", "3"], ["0", "inf", "nan"], "a number above 0"),
        (Number(1, 2, unit="metres"), ["1", "2"], ["0.9", "2.1"], "a number from 1 to 2 metres"),
        (Number(), ["-inf", "3"], ["nan", "x"], "a number"),
    ],
)
def test_numbers_within_bounds(kind: Number, good: list[str], bad: list[str], bounds: str) -> None:
    for text in good[1:]:
        assert kind.convert(text, None, None) == float(text)
    for text in bad:
        with pytest.raises(BadInput, match=f"{text}: give {bounds}"):
            kind.convert(text, None, None)


def test_an_output_needs_a_folder_and_is_none(tmp_path: Path) -> None:
    assert OUTPUT_FILE.convert(str(tmp_path / "new"), None, None) == tmp_path / "new"
    for path, part in ((tmp_path / "no" / "new", "folder does not exist"), (tmp_path, "is a folder")):
        with pytest.raises(BadInput, match=part):
            OUTPUT_FILE.convert(str(path), None, None)


def test_options_that_exclude_each_other() -> None:
    at_most_one(rest=None, rest_for="red")
    with pytest.raises(BadInput, match="--rest and --rest-for exclude each other"):
        at_most_one(rest=(0.0, 1.0), rest_for="red")


def test_a_table_fits_a_narrow_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its first column goes above the others; written to a file it stays as it is."""
    rows = [("stroke", "string", "yaw"), ("a cut into the corner pocket, then one cushion", "079p", "15.72")]
    assert len(table(rows).splitlines()) == 2
    monkeypatch.setattr("sys.stdout.isatty", lambda: True, raising=False)
    monkeypatch.setenv("COLUMNS", "30")
    lines = table(rows).splitlines()
    assert max(map(len, lines)) <= 30
    assert " ".join(line for line in lines if line[0] != " ") == "stroke a cut into the corner pocket, then one cushion"
    assert lines[-1].split() == ["079p", "15.72"]
