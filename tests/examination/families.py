"""Families of hidden causes: what each does to a `World`, or to the picture of one.

In: a world. Out: the same with another law.
"""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

from tests.examination import cloths, contacts, pictures
from tests.examination.motion import World


def _families_in(module: ModuleType) -> dict[str, Any]:
    return {name: one for name, one in vars(module).items() if getattr(one, "__module__", "") == module.__name__}


PHYSICS: dict[str, Callable[[World], None]] = _families_in(cloths) | _families_in(contacts)
PICTURES: dict[str, Callable[[tuple[float, float], float], tuple[float, float]]] = _families_in(pictures)
WITH_TEMPERATURE = tuple(
    one.__name__
    for one in (
        *(cloths.evening_cloth, contacts.warm_room, contacts.warm_balls, contacts.damp_balls),
        *(contacts.cold_rails, contacts.tacky_noses),
    )
)
FAMILIES = (*PHYSICS, *PICTURES, "nothing")
