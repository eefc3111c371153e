"""`sysid init`: what it writes is sound, for every table, and nothing that is there is touched."""

from __future__ import annotations

from pathlib import Path

import pytest

from models.table.presets import TABLE_SETS
from sysid.cli import main
from sysid.clips import inspect_clip_set
from tests.support.clip_samples import contents


@pytest.mark.parametrize("name", [*TABLE_SETS, "3.1x1.6"])
def test_a_new_clip_set_is_sound_and_has_the_tables_pockets(
    tmp_path: Path, name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--ball-diameter", "0.0525"] if "x" in name else []
    folder = tmp_path / "new"
    assert main(["init", str(folder), "--table", name, *words]) == 0
    assert f"sysid check {folder}" in capsys.readouterr().out
    found = inspect_clip_set(folder)
    clip_set = found.sound()
    assert found.warnings == () and main(["check", str(folder)]) == 0
    if name in TABLE_SETS:
        meant = TABLE_SETS[name]
        assert clip_set.table.pockets == meant.table.pockets
        assert (clip_set.table.length, clip_set.table.width) == pytest.approx((meant.table.length, meant.table.width))
        assert (clip_set.ball.diameter, clip_set.ball.mass) == pytest.approx((meant.ball.diameter, meant.ball.mass))
    text = (folder / "clips.toml").read_text()
    assert max(len(line) for line in text.splitlines() if str(folder) not in line) <= 120
    assert all(f"{key} = " in text for key in ("length", "pockets", "fps", "sigma", "struck", "note", "cue"))


def test_what_is_there_stays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    before = contents(tmp_path)
    assert main(["init", str(tmp_path), "--table", "snooker"]) == 2
    assert "already exists" in capsys.readouterr().err and contents(tmp_path) == before


def test_no_pockets_beside_a_name(tmp_path: Path) -> None:
    assert main(["init", str(tmp_path / "new"), "--table", "8ft", "--no-pockets"]) == 0
    assert inspect_clip_set(tmp_path / "new").sound().table.pockets is False


def test_pockets_of_snooker_on_a_table_of_pool_are_noted(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    toml = tmp_path / "new" / "clips.toml"
    assert main(["init", str(toml.parent), "--table", "8ft"]) == 0
    assert main(["check", str(toml.parent)]) == 0 and "note" not in capsys.readouterr().out
    toml.write_text(toml.read_text().replace('pockets = "pool 8 ft"', "pockets = true"))
    assert main(["check", str(toml.parent)]) == 0
    assert 'on a table of the size of pool 8 ft: pockets = "pool 8 ft"' in capsys.readouterr().out


@pytest.mark.parametrize("verb", ["compare", "fit", "discover", "diagnose", "measure", "plot", "review"])
def test_a_set_without_a_clip_is_refused(tmp_path: Path, verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "new"
    assert main(["init", str(folder), "--table", "8ft"]) == 0
    header, _, _ = (folder / "clips.toml").read_text().partition("[[clip]]")
    (folder / "clips.toml").write_text(f"clip = []\n{header}")
    before = contents(tmp_path)
    out = {
        "fit": ["--out", "m.toml"],
        "plot": ["--out", "p.png"],
        "discover": ["--out", "d"],
        "review": ["--save", "a"],
    }
    assert (
        main([verb, str(folder), *[str(tmp_path / word) if word[0] != "-" else word for word in out.get(verb, [])]])
        == 2
    )
    assert f"{folder}: holds no clip: " in capsys.readouterr().err and contents(tmp_path) == before
