"""Signals that end a process, workers without one, and two runs in one place."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from models.errors import BadInput
from models.files import alone_in
from models.interrupts import AGAIN_AFTER_S, Terminated, as_interrupts
from robot.device.protocol import LauncherError

ROOT = Path(__file__).parents[2]
WORKERS = """
import multiprocessing, os, time
from concurrent.futures import ProcessPoolExecutor
from models.interrupts import work_for_parent
if __name__ == "__main__":
    pool = ProcessPoolExecutor(2, multiprocessing.get_context("spawn"), work_for_parent)
    waits = [pool.submit(time.sleep, 60) for _ in range(3)]
    print(*[one.pid for one in multiprocessing.active_children()], flush=True)
    print(pool.submit(os.getpid) and "ready", flush=True)
    time.sleep(60)
"""


def lives(pid: int) -> bool:
    """Whether a process is there and no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT])
def test_a_signal_ends_a_command_as_ctrl_c_does(number: signal.Signals) -> None:
    before = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt) as caught, as_interrupts():
        os.kill(os.getpid(), number)
        time.sleep(1)
    assert isinstance(caught.value, Terminated) and caught.value.number == number
    assert signal.getsignal(number) == before


class Interrupted:
    """Interrupts its own process while it is finalised."""

    def __init__(self, number: signal.Signals) -> None:
        self.number = number

    def __del__(self) -> None:
        signal.raise_signal(self.number)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_in_a_finaliser_is_not_lost(number: signal.Signals, capfd: pytest.CaptureFixture[str]) -> None:
    before = sys.unraisablehook
    ctrl_c = signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background work ignores it
    try:
        with pytest.raises(KeyboardInterrupt), as_interrupts():
            Interrupted(number)
            time.sleep(5)
            pytest.fail("the interrupt was lost")
    finally:
        signal.signal(signal.SIGINT, ctrl_c)
    assert capfd.readouterr().err == "" and sys.unraisablehook == before


def interrupted_in_c(number: signal.Signals) -> None:
    """Interrupt the process, and print and drop that as C does."""
    try:
        signal.raise_signal(number)
    except KeyboardInterrupt as stop:
        sys.excepthook(type(stop), stop, stop.__traceback__)


@pytest.mark.parametrize("fails", [True, False])
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_that_a_compiled_module_drops_is_not_lost(
    number: signal.Signals, fails: bool, capfd: pytest.CaptureFixture[str]
) -> None:
    """As numba does while it is imported: it prints the interrupt, and fails with an ImportError of its own."""
    before = sys.excepthook
    ctrl_c = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt) as caught, as_interrupts():
            interrupted_in_c(number)
            if fails:
                raise ImportError("numba._devicearray failed to import")
            time.sleep(5)
        time.sleep(5 * AGAIN_AFTER_S)  # it does not come twice
    finally:
        signal.signal(signal.SIGINT, ctrl_c)
    assert isinstance(caught.value, Terminated) == (number == signal.SIGTERM)
    assert capfd.readouterr().err == "" and sys.excepthook == before


@pytest.mark.parametrize("kind", [ImportError, SystemError, RuntimeError])
def test_an_interrupt_that_an_import_wraps_is_an_interrupt(kind: type[Exception]) -> None:
    """Python wraps what happens while a class is made in a RuntimeError."""
    with pytest.raises(KeyboardInterrupt), as_interrupts():
        try:
            raise KeyboardInterrupt
        except KeyboardInterrupt as stop:
            raise kind("Error calling __set_name__") from stop


def test_what_goes_wrong_at_an_interrupt_is_told_all_the_same() -> None:
    with pytest.raises(LauncherError, match="did not stop"), as_interrupts():
        try:
            raise KeyboardInterrupt
        finally:
            raise LauncherError("the launcher did not stop")


def test_a_module_that_fails_by_itself_is_told() -> None:
    with pytest.raises(ImportError, match="no such module"), as_interrupts():
        raise ImportError("no such module")


def test_what_nohup_ignores_stays_ignored() -> None:
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with as_interrupts():
            os.kill(os.getpid(), signal.SIGHUP)
    finally:
        signal.signal(signal.SIGHUP, before)


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="no /proc")
def test_workers_end_with_a_parent_that_is_killed(tmp_path: Path) -> None:
    program = tmp_path / "workers.py"
    program.write_text(WORKERS)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    parent = subprocess.Popen([sys.executable, str(program)], stdout=subprocess.PIPE, text=True, env=environment)
    assert parent.stdout is not None
    workers = [int(word) for word in parent.stdout.readline().split()]
    parent.stdout.readline()
    time.sleep(1.0)  # until they work
    assert workers and all(lives(pid) for pid in workers)
    parent.kill()
    parent.wait()
    end = time.monotonic() + 10
    while any(lives(pid) for pid in workers) and time.monotonic() < end:
        time.sleep(0.05)
    assert not [pid for pid in workers if lives(pid)]


def test_a_place_is_held_by_one_run(tmp_path: Path) -> None:
    folder = tmp_path / "new" / "out"
    with alone_in(folder):
        with pytest.raises(BadInput, match="another run is writing there"), alone_in(folder):
            pass
        with alone_in(tmp_path / "new" / "other"):
            pass
        with pytest.raises(BadInput), alone_in(tmp_path / "new" / ".." / "new" / "out"):
            pass
    assert list(tmp_path.iterdir()) == []
    with alone_in(folder):
        folder.mkdir()
    assert [p.name for p in (tmp_path / "new").iterdir()] == ["out"]


@pytest.mark.parametrize("place", ["/", "/.", "//"])
def test_nobody_works_in_the_root(place: str) -> None:
    with pytest.raises(BadInput, match="name a folder"), alone_in(place):
        pass


def test_a_lock_of_a_killed_run_holds_nobody(tmp_path: Path) -> None:
    program = f"from models.files import alone_in\nimport os\nwith alone_in({str(tmp_path / 'a')!r}): os._exit(9)"
    subprocess.run([sys.executable, "-c", program], env=os.environ | {"PYTHONPATH": str(ROOT)}, check=False)
    assert (tmp_path / ".a.lock").exists()
    with alone_in(tmp_path / "a"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_cannot_be_written_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput, match="choose another place"), alone_in(tmp_path / "file" / "out"):
        pass
