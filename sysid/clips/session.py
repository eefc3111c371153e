"""Conditions under which clips were filmed: the `session` of a `[[clip]]`, and the `Session` of a shot.

In: the keys of clips.toml. Out: the values that effects see; a key that no clip has is 0.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any

from models.files.decode import Allowed
from models.shot import USUAL_TEMPERATURE, Session

MAX_NUMBERED = 8  # tables and players


@dataclass(frozen=True)
class SessionEntries:
    """The keys of a clip's `session`."""

    hour: Annotated[float, Allowed(0.0, 24.0, "h")] = math.nan
    temperature: Annotated[float, Allowed(-20.0, 60.0, "degrees Celsius")] = math.nan
    cloth_age: Annotated[float, Allowed(0.0, 1e5, "h")] = math.nan
    table: Annotated[int, Allowed(1, MAX_NUMBERED)] = 0
    player: Annotated[int, Allowed(1, MAX_NUMBERED)] = 0


def session_of(order: float, entries: Mapping[str, float]) -> Session:
    """The session of a clip at a place among the others, 0 to 1."""
    found = {key: float(value) for key, value in entries.items() if key != "temperature"}
    if "temperature" in entries:
        found["warmth"] = entries["temperature"] - USUAL_TEMPERATURE
    return Session(order, **found)


def entries_of(sessions: Sequence[Session]) -> list[dict[str, Any]]:
    """The `session` keys of each clip, of those that some clip has with a nonzero value."""
    rows = [dataclasses.asdict(one) for one in sessions]
    keys = [key for key in rows[0] if key != "order" and any(row[key] for row in rows)] if rows else []
    return [dict(_entry(key, row[key]) for key in keys) for row in rows]


def _entry(key: str, value: float) -> tuple[str, float]:
    if key == "warmth":
        return "temperature", round(value + USUAL_TEMPERATURE, 9)
    return key, int(value) if key in ("table", "player") else value
