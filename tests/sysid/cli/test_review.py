"""`sysid review`: the viewer is started, and listens to this machine alone."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from sysid.cli import main


def test_a_recording_is_shown_to_this_machine_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    called: list[list[str]] = []

    def pretend(words: list[str], check: bool) -> subprocess.CompletedProcess[bytes]:
        called.append(words)
        return subprocess.CompletedProcess(words, len(called) - 1)

    monkeypatch.setattr("sysid.cli.review.subprocess.run", pretend)
    assert main(["review", str(tmp_path)]) == 2
    assert "review.rrd: no such recording" in capsys.readouterr().err
    (tmp_path / "review.rrd").write_bytes(b"")
    assert main(["review", str(tmp_path)]) == 0
    assert main(["review", str(tmp_path / "review.rrd"), "--web"]) == 1, "the viewer's failure is told"
    for words in called:
        assert words[1:4] == [str(tmp_path / "review.rrd"), "--bind", "127.0.0.1"]
    assert called[1][4:] == ["--web-viewer"]
