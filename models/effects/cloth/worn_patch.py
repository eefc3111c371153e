"""A round patch of cloth that is worn, burnt or soiled: friction of its own within its edge.

Within `radius` of (x, y) rolling resistance is mu_r (1 + roll) and sliding friction mu_s (1 + slide); outside nothing
changes. Never less than 0.05 of either. Source: geometry; the spots where balls are broken and racked wear first. Its
place and size are fitted with it. Leaves out a gradual edge, other shapes and a second patch.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from models.compiled import compiled
from models.effect import EDGE_OVERSHOOT_M, MIN_FRICTION_SHARE, BallState, Effect, param
from models.shot import Table

NEWTON_STEPS = 4  # from the time of crossing at constant velocity to that at constant acceleration
FIRST_RADIUS_M = 0.3  # of the patches that a search starts from [m]
FIRST_SPACING = 1.5  # of their centres, over the radius: every place is well inside one


@compiled
def until_circle(x: float, y: float, vx: float, vy: float, ax: float, ay: float, radius: float) -> float:
    """When a centre at (x, y) from the middle of a circle crosses it, and a bit more [s]; inf if never."""
    squared, along = vx * vx + vy * vy, x * vx + y * vy
    inside = x * x + y * y < radius * radius
    edge = radius + EDGE_OVERSHOOT_M if inside else radius - EDGE_OVERSHOOT_M
    room = along * along - squared * (x * x + y * y - edge * edge)
    if squared <= 0.0 or room <= 0.0 or (not inside and along >= 0.0):
        return math.inf
    t = (-along + math.sqrt(room)) / squared if inside else (-along - math.sqrt(room)) / squared
    for _ in range(NEWTON_STEPS):
        px, py = x + t * (vx + 0.5 * ax * t), y + t * (vy + 0.5 * ay * t)
        rate = 2.0 * (px * (vx + ax * t) + py * (vy + ay * t))
        if rate == 0.0:
            break
        t -= (px * px + py * py - edge * edge) / rate
    return t if t > 0.0 else math.inf


@dataclass(frozen=True)
class WornPatch(Effect):
    """Friction within a circle on the cloth."""

    roll: float = param(
        0.3, off=0.0, unit="1", bounds=(-0.9, 4.0), source="estimate: cloths differ by that from new to worn"
    )
    slide: float = param(0.1, off=0.0, unit="1", bounds=(-0.9, 4.0), source="as roll, for sliding balls")
    x: float = param(0.0, off=None, unit="m", bounds=(-2.0, 2.0), source="anywhere on the cloth")
    y: float = param(0.0, off=None, unit="m", bounds=(-1.0, 1.0), source="anywhere on the cloth")
    radius: float = param(FIRST_RADIUS_M, off=None, unit="m", bounds=(0.03, 1.0), source="a spot to a third of a table")

    @classmethod
    def starts(cls, table: Table) -> tuple[Effect, ...]:
        """Patches side by side over the whole cloth."""
        spacing = FIRST_SPACING * FIRST_RADIUS_M
        nx, ny = math.ceil(table.length / spacing), math.ceil(table.width / spacing)
        places = [((i + 0.5) / nx - 0.5, (j + 0.5) / ny - 0.5) for i in range(nx) for j in range(ny)]
        return tuple(cls(x=table.length * u, y=table.width * v) for u, v in places)

    def forces(self, ball: BallState) -> None:
        """The factors on rolling resistance and sliding friction."""
        if math.hypot(ball.x - self.x, ball.y - self.y) < self.radius:
            ball.roll_factor *= max(1.0 + self.roll, MIN_FRICTION_SHARE)
            ball.slide_factor *= max(1.0 + self.slide, MIN_FRICTION_SHARE)

    def horizon(self, ball: BallState) -> float:
        """Until it crosses the edge [s]."""
        return until_circle(ball.x - self.x, ball.y - self.y, ball.vx, ball.vy, ball.ax, ball.ay, self.radius)
