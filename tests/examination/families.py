"""Families of hidden causes: what each does to a `World`, or to the picture of one.

In: a world. Out: the same with another law.
"""

from __future__ import annotations

from collections.abc import Callable

from tests.examination import cloths, contacts
from tests.examination.motion import World
from tests.examination.pictures import PICTURES

Change = Callable[[World], None]
PHYSICS: dict[str, Change] = {
    name: change
    for module in (cloths, contacts)
    for name, change in vars(module).items()
    if getattr(change, "__module__", "") == module.__name__
}
WITH_TEMPERATURE = tuple(
    one.__name__
    for one in (
        *(cloths.evening_cloth, contacts.warm_room, contacts.warm_balls, contacts.damp_balls),
        *(contacts.cold_rails, contacts.tacky_noses),
    )
)
FAMILIES = (*PHYSICS, *PICTURES, "nothing")
