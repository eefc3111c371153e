"""Base class of effects: one physical idea, its parameters with unit, bounds and source, and its hooks.

An effect is a frozen dataclass in a file of its own below `models/effects/` (or in a user's folder). A parameter is
one number or an (nsim,) array, so that one batch runs many variants. Its hooks are compiled scalar functions
(models/hooks.py). Where all its parameters are at their off values an effect is left out of the world, so that off is
absence to the last bit.
"""

from __future__ import annotations

import dataclasses
import math
import re
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from models.hooks import (
    COMPILED_HOOKS,
    BallState,
    ImageState,
    ImpactState,
    Layout,
    StrokeState,
    push_along,
    push_rolling,
)

if TYPE_CHECKING:
    import mujoco

    from models.shot import Table

Array = NDArray[np.float64]
STILL = 1e-6  # speed or slip below which there is none [m/s]
EDGE_OVERSHOOT_M = 1e-9  # distance beyond an edge at which a step ends, so that the next begins on the other side [m]
REFERENCE_SPEED = 1.0  # speed or slip at which restitution and friction of the base hold [m/s]
MIN_FRICTION_SHARE = 0.05  # of the friction of the base, that any effect leaves
STRUCK_BALL = 0  # number of the ball that the cue strikes
RAIL_PX, RAIL_MX, RAIL_PY, RAIL_MY = range(4)  # numbers of the rails at +x, -x, +y, -y

__all__ = [
    "EDGE_OVERSHOOT_M", "MIN_FRICTION_SHARE", "RAIL_MX", "RAIL_MY", "RAIL_PX", "RAIL_PY", "REFERENCE_SPEED", "STILL",
    "STRUCK_BALL", "Array", "BallState", "Effect", "ImageState", "ImpactState", "StrokeState", "param", "push_along",
    "push_rolling",
]  # fmt: skip


def param(
    default: float, *, off: float | None, unit: str, bounds: tuple[float, float], source: str,
    published: tuple[float, float] | None = None, published_by: str = "",
) -> Any:  # fmt: skip
    """Declare a parameter: its usual value, the value at which it vanishes, its unit, bounds and source.

    A parameter that only shapes the effect, and vanishes at no value of its own, has `off` None. `published` are the
    smallest and the largest value that measurements of real tables gave, and `published_by` who gave them: how far a
    table that nobody measured may be from the usual value (planner/evaluation/literature.py).
    """
    about = {"off": off, "unit": unit, "bounds": bounds, "source": source}
    if published is not None:
        about |= {"published": published, "published_by": published_by}
    return dataclasses.field(default=default, metadata=about)


@cache
def _parameters(kind: type[Effect]) -> dict[str, dict[str, Any]]:
    return {f.name: {**f.metadata, "default": f.default} for f in dataclasses.fields(kind)}


@dataclass(frozen=True)
class Effect:
    """Base of all effects: every hook is there and does nothing."""

    slot: ClassVar[str] = ""  # effects of one slot replace each other; "" adds to the others
    first: ClassVar[bool] = False  # it says what the cloth carries, before the others push
    last: ClassVar[bool] = False  # its forces react to what the others apply
    plain: ClassVar[bool] = False  # its edit of the MJCF is the same whatever its parameters
    beside: ClassVar[tuple[str, ...]] = ()  # effects of which it needs one: alone it changes nothing
    resolves: ClassVar[str] = ""  # the kind of impact whose contact it takes over from MuJoCo: "ball" or "cushion"

    @classmethod
    def name(cls) -> str:
        """The class's name in snake case, as model files and commands use it."""
        return re.sub(r"(?<!^)(?=[A-Z])", "_", cls.__name__).lower()

    @classmethod
    def parameters(cls) -> dict[str, dict[str, Any]]:
        """Metadata of every parameter: name -> off, unit, bounds, source, default."""
        return _parameters(cls)  # type: ignore[arg-type] # dataclasses hide that classes hash

    @classmethod
    def opens(cls, *hooks: str) -> bool:
        """Whether it uses any of these hooks."""
        return any(getattr(cls, hook) is not getattr(Effect, hook) for hook in hooks)

    @classmethod
    def opens_only(cls, hook: str) -> bool:
        """Whether it uses this hook and no other."""
        return cls.opens(hook) and not cls.opens(*({"edit", *COMPILED_HOOKS} - {hook}))

    @classmethod
    def impacts(cls) -> tuple[str, ...] | None:
        """Kinds of impacts, "ball" and "cushion", at which alone it acts; None where it acts elsewhere as well."""
        return ("ball", "cushion") if cls.opens_only("impact") else None

    def is_off(self) -> bool:
        """True where every parameter that has an off value stands at it in every simulation."""
        known = {k: m["off"] for k, m in self.parameters().items() if m["off"] is not None}
        return all(bool(np.all(getattr(self, k) == off)) for k, off in known.items())

    def select(self, index: Any) -> Effect:
        """The effect with per-simulation parameters narrowed to some simulations."""
        arrays = {k: v[index] for k in self.parameters() if np.ndim(v := getattr(self, k))}
        return dataclasses.replace(self, **arrays) if arrays else self

    @classmethod
    def layout(cls) -> Layout:
        """Names of the numbers that its hooks find in `self`: its parameters, and after them what else they need."""
        return tuple(cls.parameters())

    @classmethod
    def starts(cls, table: Table) -> tuple[Effect, ...]:
        """Where a search for the effect starts: itself at usual values; more than one where it acts in some place."""
        return (cls(),)

    @classmethod
    def column(cls, key: str) -> int:
        """Where in `row` a parameter stands."""
        return list(cls.parameters()).index(key)

    def row(self, count: int) -> Array:
        """Those numbers in `count` simulations: (count, k)."""
        out = np.empty((count, len(self.layout())))
        for k, key in enumerate(self.parameters()):
            out[:, k] = getattr(self, key)
        return out

    def edit(self, spec: mujoco.MjSpec) -> None:
        """Change the MJCF before it is compiled; an effect that does more than that plays in MuJoCo alone."""

    # What follows is compiled (models/hooks.py): arithmetic on numbers, of one ball, impact, stroke or image. `self`
    # has the parameters and nothing else.

    def forces(self, ball: BallState) -> None:
        """Add accelerations to `ball.ax` ... `ball.bz`, or change the factors on the cloth's friction.

        They must change smoothly along a ball's way but where `horizon` says.
        """

    def horizon(self, ball: BallState) -> float:
        """How long until these forces switch [s]; what varies smoothly needs none. `ball.ax` ... hold all that acts."""
        return math.inf

    def impact(self, hit: ImpactState) -> None:
        """Change the fields of `hit` from `restitution` on."""

    def strike(self, cue: StrokeState) -> None:
        """Change the commanded motion of the struck ball, the first of every shot, to the actual one."""

    def exposures(self, stamp: float) -> float:
        """The actual time of exposure for a reported time stamp [s]."""
        return stamp

    def observe(self, image: ImageState) -> None:
        """Move `image.x` and `image.y` to where the camera reports a ball; its time is the true one."""
