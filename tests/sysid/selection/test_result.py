"""The ladder of a discovery."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any, cast

from sysid.selection.result import DiscoveryResult


def begun() -> DiscoveryResult:
    return DiscoveryResult(cast(Any, SimpleNamespace()), (cast(Any, "base"),), ((),), ())


def test_a_ladder_has_only_effects_of_its_last_verdict() -> None:
    one = begun().with_step(cast(Any, "drag"), ("air_drag",), ())
    both = one.with_step(cast(Any, "both"), ("air_drag", "nose_height"), ())
    assert both.ladder == ("base", "drag", "both") and both.verdict == ("air_drag", "nose_height")
    other = both.with_step(cast(Any, "nose"), ("nose_height",), ("air_drag",))
    assert other.ladder == ("base", "nose") and other.verdict == ("nose_height",) and other.pruned == ("air_drag",)


def test_what_was_named_on_the_way_and_dropped_is_in_no_verdict() -> None:
    found = begun().with_step(cast(Any, "drag"), ("air_drag",), ()).with_step(cast(Any, "last"), (), ("air_drag",))
    assert found.verdict == () and found.ladder == ("last",) and found.pruned == ("air_drag",)
