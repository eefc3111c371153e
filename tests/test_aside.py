"""Work beside other work, in a process of its own."""

from __future__ import annotations

import os
import signal
import sys
import time
from multiprocessing import active_children
from pathlib import Path

import numpy as np
import pytest

from models.model_file import full_model
from models.shot import Ball, Shot, Table
from models.simulate import simulate
from sysid.aside import Aside, shared

forked = pytest.mark.skipif(
    sys.platform != "linux" or len(os.sched_getaffinity(0)) < 2, reason="one core, or no fork: work is done in place"
)


def rolled(speeds: tuple[float, ...]) -> bytes:
    table, ball = Table(3.569, 1.778), Ball(0.0262, 0.142)
    times = np.linspace(0, 2, 50)
    shots = [
        Shot(("white",), np.array([[0.1, 0.2]]), np.array([[v, 0.1]]), np.array([[0.0, 0.0, 5.0]]), times)
        for v in speeds
    ]
    return b"".join(t.position.tobytes() for t in simulate(full_model(table, ball), shots))


@forked
def test_it_is_done_elsewhere() -> None:
    with Aside(os.getpid) as aside:
        assert aside.result() != os.getpid()


def test_simulations_aside_are_those_done_here() -> None:
    with Aside(lambda: rolled((1.0, 2.0))) as aside:
        assert rolled((1.0, 2.0)) == aside.result()


def test_what_it_raises_is_raised_where_it_is_asked_for() -> None:
    def fails() -> None:
        raise KeyError("no such ball")

    with Aside(fails) as aside, pytest.raises(KeyError, match="no such ball"):
        aside.result()


@forked
def test_work_that_was_killed_is_done_again(tmp_path: Path) -> None:
    here = os.getpid()

    def killed() -> str:
        if os.getpid() != here:
            os.kill(os.getpid(), signal.SIGKILL)
        return "done"

    with Aside(killed) as aside:
        assert aside.result() == "done"


@forked
def test_what_is_not_asked_for_ends_with_its_context() -> None:
    began = time.monotonic()
    with Aside(lambda: time.sleep(600)):
        assert active_children()
    assert time.monotonic() - began < 60 and not active_children()


@pytest.mark.parametrize("count", [0, 1, 2, 5])
def test_shared_work_keeps_its_order(count: int) -> None:
    assert shared(lambda k: k * k, count) == [k * k for k in range(count)]


@forked
def test_work_aside_shares_no_more() -> None:
    with Aside(lambda: {os.getpid(), *shared(lambda _: os.getpid(), 4)}) as aside:
        assert len(aside.result()) == 1
