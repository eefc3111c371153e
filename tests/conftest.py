"""What all tests share. The drawing library is chosen here, before any test imports MuJoCo."""

from __future__ import annotations

import os
import signal
from pathlib import Path

import pytest
from hypothesis import settings

from models.mjcf.gl import RENDERING_NEEDS, can_render, choose_backend

choose_backend()
for name in ("SIGHUP", "SIGQUIT"):  # ignored under nohup and in the background of a script: tests would wait in vain
    if hasattr(signal, name):
        signal.signal(getattr(signal, name), signal.SIG_DFL)

settings.register_profile("untimed", deadline=None)  # how long an example takes depends on what else a machine does
settings.load_profile("untimed")
ROOT = Path(__file__).resolve().parents[1]


def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what draws where nothing can be drawn."""
    if item.get_closest_marker("gl") and not can_render():
        pytest.skip(RENDERING_NEEDS)


@pytest.fixture
def gl() -> str:
    """The back end that draws; the test is skipped where there is none."""
    if not can_render():
        pytest.skip(RENDERING_NEEDS)
    return choose_backend()


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """The folder of published and hidden data: $CUELAB_DATA, or ../shared/data beside the checkout."""
    folder = Path(os.environ.get("CUELAB_DATA") or ROOT.parent / "shared" / "data")
    if not folder.is_dir():
        pytest.skip("no data: set CUELAB_DATA, or put it at ../shared/data beside the checkout")
    return folder
