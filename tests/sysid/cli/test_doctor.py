"""`sysid doctor`: every step with the right words, and where it stops."""

from __future__ import annotations

import shlex
import shutil
from pathlib import Path

import click
import pytest

from models.commands.console import Status
from sysid.cli import doctor
from sysid.cli.verbs import main
from tests.fuzz.verbs import SEEDS

CLIPS = 'format = "billiard-clips/1"\n'


def stand_in(name: str, status: int, made: str, called: list[tuple[str, ...]]) -> click.Command:
    """A verb that notes its words and makes the file that the one of this name would."""

    @click.command(name, context_settings={"ignore_unknown_options": True, "allow_extra_args": True})
    @click.pass_context
    def verb(context: click.Context) -> int:
        words = tuple(context.args)
        called.append((name, *words))
        if made:
            out = Path(words[words.index("--out") + 1])
            path = out / made if "." in made else out
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(CLIPS, encoding="utf-8")
        return status

    return verb


@pytest.fixture
def called(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, ...]]:
    """The verbs that were run, each with its words."""
    seen: list[tuple[str, ...]] = []
    verbs = (("calibrate", 0, "camera"), ("track", 0, "clips.toml"), ("check", 0, ""), ("discover", 1, ""))
    for name, status, made in verbs:
        monkeypatch.setattr(doctor, name, stand_in(name, status, made, seen))
    return seen


def test_steps_follow_each_other_with_what_is_known(called: list[tuple[str, ...]], tmp_path: Path) -> None:
    assert main(["doctor", "a.mp4", "b.mp4", "--table", "8ft", "--fps", "50", "--out", str(tmp_path / "out")]) == 1
    assert [words[0] for words in called] == ["calibrate", "track", "check", "discover"]
    calibrate, track, _, discover = called
    assert calibrate[1:5] == ("a.mp4", "b.mp4", "--table", "8ft") and "--no-pockets" not in calibrate
    assert track[1:3] == ("a.mp4", "b.mp4") and track[track.index("--fps") + 1] == "50"
    assert track[track.index("--mass") + 1] == "0.163"
    assert discover[1] == str(tmp_path / "out" / "clips")


def test_a_table_by_name_may_be_said_to_have_no_pockets(called: list[tuple[str, ...]], tmp_path: Path) -> None:
    assert main(["doctor", "a.mp4", "--table", "8ft", "--no-pockets", "--out", str(tmp_path)]) == 1
    assert "--no-pockets" in called[0]


def test_what_is_known_of_the_camera_goes_to_calibrate(called: list[tuple[str, ...]], tmp_path: Path) -> None:
    known = ["--corners", "1,2 3,4 5,6 7,8", "--hold", "--fov", "60.0"]
    board = ["--board", "charuco:7x5", "--square", "0.04", "--board-marker", "0.03", "--lens", "b.mp4"]
    out = str(tmp_path / "out")
    assert main(["doctor", "a.mp4", "--table", "8ft", *known, *board, "--out", out]) == 1
    words = list(called[0])
    for option, value in (
        ("--corners", "1,2 3,4 5,6 7,8"),
        ("--fov", "60"),
        *zip(board[::2], board[1::2], strict=True),
    ):
        assert words[words.index(option) + 1] == value
    assert "--hold" in words


def test_it_names_the_command_that_goes_on_with_a_camera_in_doubt(
    called: list[tuple[str, ...]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(doctor, "calibrate", stand_in("calibrate", int(Status.FINDING), "camera", called))
    words = ["doctor", "a b.mp4", "--table", "8ft", "--out", str(tmp_path / "out")]
    assert main(words) == 1
    (line,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("to continue nevertheless: "))
    assert shlex.split(line.partition(": ")[2])[1:] == [*words, "--accept-camera"]


def test_a_camera_that_is_there_is_kept(called: list[tuple[str, ...]], tmp_path: Path) -> None:
    shutil.copy(SEEDS / "camera.toml", tmp_path / "camera.toml")
    assert main(["doctor", "a.mp4", "--table", "carom", "--out", str(tmp_path)]) == 1
    assert [words[0] for words in called] == ["track", "check", "discover"]


@pytest.mark.parametrize(("failing", "last"), [("calibrate", "calibrate"), ("track", "track"), ("check", "check")])
def test_it_stops_where_a_step_is_not_to_be_trusted(
    called: list[tuple[str, ...]], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, failing: str, last: str,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    made = {"calibrate": "camera", "track": "clips.toml", "check": ""}[failing]
    monkeypatch.setattr(doctor, failing, stand_in(failing, int(Status.FINDING), made, called))
    assert main(["doctor", "a.mp4", "--table", "1.881x0.943", "--diameter", "0.0523", "--out", str(tmp_path)]) == 1
    assert called[-1][0] == last
    if failing == "calibrate":
        assert not (tmp_path / doctor.CAMERA_FILE).exists() and "camera.png" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("--table", "11ft"), "--table 11ft: is not a known table; give one of snooker, pool 9 ft"),
        (("--table", "snooker 10 ft"), "the rules of snooker define only the full size of 12 ft, and makers differ"),
        (("--table", "snokker"), 'did you mean "snooker"?'),
        (("--table", "1.881x0.943"), "give --ball-diameter"),
        (("--table", "0.9x1.8", "--diameter", "0.05"), "the longer first"),
    ],
)
def test_a_table_that_is_not_known(
    words: tuple[str, ...], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["doctor", "a.mp4", *words, "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert told in error and error.count("\n") == 1 and not (tmp_path / "out").exists()
