"""Families of hidden causes in how balls slide, roll and spin on the cloth, and in the camera's clock."""

from __future__ import annotations

import math

from tests.examination.laws import heading, plus, times
from tests.examination.motion import World


def worn_lane(world: World) -> None:
    """Rolling friction 1.4 times where |y| is below 0.25 m."""
    world.roll = times(world.roll, lambda seen: 1.4 if abs(seen.ball[1]) < 0.25 else 1.0)


def slippery_at_speed(world: World) -> None:
    """Sliding friction falls to three quarters as slip grows: 0.75 + 0.25 exp(-slip / 0.8)."""
    world.slide = times(world.slide, lambda seen: 0.75 + 0.25 * math.exp(-seen.slip / 0.8))


def uneven_stretch(world: World) -> None:
    """Rolling friction grows along the table: times 1 + 0.12 x."""
    world.roll = times(world.roll, lambda seen: 1.0 + 0.12 * seen.ball[0])


def two_pieces(world: World) -> None:
    """Sliding friction 1.25 times where y is above 0.1 m."""
    world.slide = times(world.slide, lambda seen: 1.25 if seen.ball[1] > 0.1 else 1.0)


def damp_end(world: World) -> None:
    """Rolling friction is higher by 0.35 of itself for every metre beyond x = 0.6 m."""
    world.roll = times(world.roll, lambda seen: 1.0 + 0.35 * max(0.0, seen.ball[0] - 0.6))


def brushed_one_way(world: World) -> None:
    """Sliding friction is 1 + 0.15 cos(heading) times as high: the cloth is brushed along x."""
    world.slide = times(world.slide, lambda seen: 1.0 + 0.15 * math.cos(heading(seen)))


def evening_cloth(world: World) -> None:
    """Rolling friction grows by 0.03 of itself for every degree that the room is warmer, of which the clips tell."""
    world.roll = times(world.roll, lambda seen: 1.0 + 0.03 * (seen.celsius - 20.0))


def pressed_seam(world: World) -> None:
    """Rolling friction is 1 + 0.8 exp(-(x / 0.15)^2) times as high: something lies below the middle of the cloth."""
    world.roll = times(world.roll, lambda seen: 1.0 + 0.8 * math.exp(-((seen.ball[0] / 0.15) ** 2)))


def damp_edges(world: World) -> None:
    """Sliding friction is 1.3 times as high within 0.25 m of a long cushion."""
    world.slide = times(
        world.slide, lambda seen: 1.3 if world.width / 2 - world.radius - abs(seen.ball[1]) < 0.25 else 1.0
    )


def sticky_crawl(world: World) -> None:
    """Rolling friction is 1 + 0.30 exp(-speed / 0.25) times as high: slow balls stop early."""
    world.roll = times(world.roll, lambda seen: 1.0 + 0.30 * math.exp(-math.hypot(seen.ball[2], seen.ball[3]) / 0.25))


def worn_centre(world: World) -> None:
    """Sliding friction is 0.85 + 0.12 r^2 times as high, r in metres from the middle of the table."""
    world.slide = times(world.slide, lambda seen: 0.85 + 0.12 * (seen.ball[0] ** 2 + seen.ball[1] ** 2))


def drying_cloth(world: World) -> None:
    """Rolling friction is 1 - 0.12 exp(-order / 0.25) times as high: the cloth dries in the session."""
    world.roll = times(world.roll, lambda seen: 1.0 - 0.12 * math.exp(-seen.order / 0.25))


def brushed_pile(world: World) -> None:
    """Rolling balls are pushed across their way by 0.02 cos(heading) m/s^2: the pile of the cloth points along y."""
    world.across = lambda seen: 0.02 * math.cos(heading(seen))


def spilled_water(world: World) -> None:
    """Rolling friction is 1.5 times as high where x is below -0.5 m, in the last 40 % of the session."""
    world.roll = times(world.roll, lambda seen: 1.5 if seen.ball[0] < -0.5 and seen.order > 0.6 else 1.0)


def slow_clock(world: World) -> None:
    """The camera's clock falls behind in the session: frames last longer by 0.4 % times the order."""
    world.frame *= 1.0 + 0.004 * world.order


def ironed_at_first(world: World) -> None:
    """Rolling friction falls along the table in the first half of the session, times 1 - 0.15 x."""
    world.roll = times(world.roll, lambda seen: 1.0 - 0.15 * seen.ball[0] if seen.order < 0.5 else 1.0)


def woven_cloth(world: World) -> None:
    """Sliding friction is 1 + 0.12 cos(2 heading) times as high: the weave runs along x."""
    world.slide = times(world.slide, lambda seen: 1.0 + 0.12 * math.cos(2.0 * heading(seen)))


def trodden_way(world: World) -> None:
    """Rolling friction is 0.75 times as high within 0.25 m of the line y = 0.4 x: players shoot that way."""
    world.roll = times(
        world.roll, lambda seen: 0.75 if abs(seen.ball[1] - 0.4 * seen.ball[0]) / math.hypot(1.0, 0.4) < 0.25 else 1.0
    )


def brushed_between(world: World) -> None:
    """Sliding friction is 0.82 times as high in the middle third of the session: the cloth was brushed, then ironed."""
    world.slide = times(world.slide, lambda seen: 0.82 if 1 / 3 < seen.order < 2 / 3 else 1.0)


def linty_half(world: World) -> None:
    """Sidespin dies 1.5 times as fast where x is above 0.3 m."""
    world.spin = times(world.spin, lambda seen: 1.5 if seen.ball[0] > 0.3 else 1.0)


def rubbed_chalk(world: World) -> None:
    """Sliding friction of the struck ball is 1 + 0.2 exp(-order / 0.4) times as high: its chalk is rubbed off."""
    world.slide = times(
        world.slide, lambda seen: 1.0 + (0.2 * math.exp(-seen.order / 0.4) if seen.number == 0 else 0.0)
    )


def draughty_room(world: World) -> None:
    """Rolling balls are pushed to the left of their way by 0.015 m/s^2 in the second half of the session."""
    world.across = plus(world.across, lambda seen: 0.015 if seen.order > 0.5 else 0.0)


def bumped_clock(world: World) -> None:
    """The camera's clock runs 0.4 % fast after the middle of the session."""
    world.frame = 0.996 if world.order > 0.5 else 1.0


def sunlit_half(world: World) -> None:
    """Rolling friction is 1.12 times as high where x is above 0, after the middle of the session: the sun comes in."""
    world.roll = times(world.roll, lambda seen: 1.12 if seen.ball[0] > 0.0 and seen.order > 0.5 else 1.0)


def pressed_waves(world: World) -> None:
    """Sliding friction is 1 + 0.10 sin(3 x) times as high, x in metres: the cloth was ironed in pieces."""
    world.slide = times(world.slide, lambda seen: 1.0 + 0.10 * math.sin(3.0 * seen.ball[0]))


def leaning_pile(world: World) -> None:
    """Rolling friction is 1 + 0.2 sin(heading) times as high: the pile of the cloth leans towards -y."""
    world.roll = times(world.roll, lambda seen: 1.0 + 0.2 * math.sin(heading(seen)))


def polished_lane(world: World) -> None:
    """Sliding friction is 0.8 times as high where x is between -0.35 and 0.35 m."""
    world.slide = times(world.slide, lambda seen: 0.8 if abs(seen.ball[0]) < 0.35 else 1.0)


def clinging_nap(world: World) -> None:
    """Sidespin dies 1 + 0.5 exp(-speed / 0.4) times as fast: slow balls sink into the nap."""
    world.spin = times(world.spin, lambda seen: 1.0 + 0.5 * math.exp(-math.hypot(seen.ball[2], seen.ball[3]) / 0.4))


def pulled_cloth(world: World) -> None:
    """Rolling friction is 1 - 0.2 cos(heading) times as high in the second half: the cloth was pulled towards +x."""
    world.roll = times(world.roll, lambda seen: 1.0 - (0.2 * math.cos(heading(seen)) if seen.order > 0.5 else 0.0))
