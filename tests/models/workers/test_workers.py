"""Work for other processes: order of results, orders that a worker refuses, and addresses where nobody answers."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from models.effect_catalogue import add_folder
from models.errors import BadInput
from models.interrupts import given_up_when, go_on
from models.workers import cluster as dask
from models.workers import open_workers
from models.workers.order import Requirements, difference, effects_digest, perform, source_stamp
from tests.support.clip_samples import refusal
from tests.support.worker_tasks import square

EFFECT = """
from dataclasses import dataclass
from models.effect import Effect, param


@dataclass(frozen=True)
class LocalSpare(Effect):
    size: float = param(0.1, unit="1", bounds=(0.0, 1.0), source="made up", off=0.0)
"""


def test_results_come_in_turn_from_processes() -> None:
    with open_workers(None, 2) as workers:
        later_first = [(k, 0.2 if k == 0 else 0.0) for k in range(5)]
        assert list(workers.in_turn(square, later_first)) == [k * k for k in range(5)]
        assert sorted(workers.as_they_come(square, [(3,), (4,)])) == [(0, 9), (1, 16)]


def test_a_stamp_names_the_sources_and_what_computes() -> None:
    stamp = source_stamp()
    assert {"cuelab", "Python", "numpy", "numba", "mujoco"} <= set(stamp)
    assert difference(stamp, stamp) == ""
    assert difference(stamp, stamp | {"numpy": "1.0"}).startswith("numpy is 1.0 there")
    assert "cuelab is absent there" in difference(stamp, {})


def test_a_worker_refuses_what_it_would_compute_otherwise() -> None:
    other = Requirements(source_stamp() | {"cuelab": "another"})
    with pytest.raises(BadInput, match=r"cuelab is .* there and another here"):
        perform(other, b"never unpickled")


def test_a_worker_refuses_other_effects_of_the_user(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from models import effect_catalogue

    monkeypatch.setattr(effect_catalogue, "_added", {})
    with pytest.raises(BadInput, match=r"worker on .*: .*no such folder"):
        Requirements({}, (str(tmp_path / "none"),), "").check()
    (tmp_path / "spare.py").write_text(EFFECT)
    add_folder(tmp_path)
    order = Requirements({}, (str(tmp_path),), effects_digest())
    order.check()
    (tmp_path / "spare.py").write_text(EFFECT + "\n# changed\n")
    with pytest.raises(BadInput, match="holds different effects there"):
        order.check()


def test_work_that_nobody_waits_for_ends_with_what_it_is_part_of() -> None:
    reached = []
    with given_up_when(lambda: True):
        with given_up_when(lambda: False):
            go_on()
            reached.append("inside")
        reached.append("between")
        go_on()
        reached.append("after")
    go_on()
    assert reached == ["between"]


@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:9", "127.0.0.1:9", "nonsense://x", "tcp://no.such.host.invalid:8786"]
)
def test_an_address_where_nobody_answers_is_refused(address: str, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed", reason="no Dask")
    monkeypatch.setattr(dask, "CONNECT_TIMEOUT_S", 1)
    text = refusal(lambda: open_workers(address, 0).__enter__())
    assert text.startswith(f"--scheduler {address}: no scheduler answers") and "dask scheduler" in text


def test_without_dask_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert "'.[cluster]'" in refusal(lambda: open_workers("tcp://127.0.0.1:8786", 0).__enter__())
