"""Families of hidden causes: what each does to a `World`.

In: a world. Out: the same with another law. Those of the picture of it are in pictures.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable

from tests.examination.motion import Law, Seen, World
from tests.examination.pictures import PICTURES

Change = Callable[[World], None]


def _times(law: Law, factor: Law) -> Law:
    return lambda seen: law(seen) * factor(seen)


def _plus(law: Law, more: Law) -> Law:
    return lambda seen: law(seen) + more(seen)


def _heading(seen: Seen) -> float:
    return math.atan2(seen.ball[3], seen.ball[2])


def worn_lane(world: World) -> None:
    """Rolling friction 1.4 times where |y| is below 0.25 m."""
    world.roll = _times(world.roll, lambda seen: 1.4 if abs(seen.ball[1]) < 0.25 else 1.0)


def slippery_at_speed(world: World) -> None:
    """Sliding friction falls to three quarters as slip grows: 0.75 + 0.25 exp(-slip / 0.8)."""
    world.slide = _times(world.slide, lambda seen: 0.75 + 0.25 * math.exp(-seen.slip / 0.8))


def sidespin_on_rubber(world: World) -> None:
    """A cushion returns less by 0.0012 for every radian a second of sidespin."""
    world.cushion_e = _plus(world.cushion_e, lambda seen: -0.0012 * abs(seen.ball[6]))


def warm_middle(world: World) -> None:
    """The long cushions return 0.08 less beyond 0.9 m from their middle."""
    world.cushion_e = _plus(
        world.cushion_e, lambda seen: -0.08 if seen.rail[1] == "y" and abs(seen.ball[0]) > 0.9 else 0.0
    )


def chalk_gathers(world: World) -> None:
    """Friction between balls grows from clip to clip, by 0.10 in all."""
    world.ball_mu = _plus(world.ball_mu, lambda seen: 0.10 * seen.order)


def soft_ball(world: World) -> None:
    """Balls return 0.15 exp(-approach / 0.5) less: slow collisions lose most."""
    world.ball_e = _plus(world.ball_e, lambda seen: -0.15 * math.exp(-seen.approach / 0.5))


def warm_room(world: World) -> None:
    """Cushions return 0.006 more for every degree that the room is warmer, of which the clips tell."""
    world.cushion_e = _plus(world.cushion_e, lambda seen: 0.006 * (seen.celsius - 20.0))


def uneven_stretch(world: World) -> None:
    """Rolling friction grows along the table: times 1 + 0.12 x."""
    world.roll = _times(world.roll, lambda seen: 1.0 + 0.12 * seen.ball[0])


def two_pieces(world: World) -> None:
    """Sliding friction 1.25 times where y is above 0.1 m."""
    world.slide = _times(world.slide, lambda seen: 1.25 if seen.ball[1] > 0.1 else 1.0)


def chalky_stretch(world: World) -> None:
    """The cushion at +y has 0.10 more friction between x = -0.9 and 0.3 m."""
    world.cushion_mu = _plus(
        world.cushion_mu, lambda seen: 0.10 if seen.rail == "+y" and -0.9 < seen.ball[0] < 0.3 else 0.0
    )


def tired_rubber(world: World) -> None:
    """A cushion returns less by 0.06 for every m/s of approach beyond 1.2 m/s."""
    world.cushion_e = _plus(world.cushion_e, lambda seen: -0.06 * max(0.0, seen.approach - 1.2))


def soft_red(world: World) -> None:
    """The red ball comes back from cushions with 0.06 less restitution."""
    world.cushion_e = _plus(world.cushion_e, lambda seen: -0.06 if seen.number == 1 else 0.0)


def gripping_spin(world: World) -> None:
    """Friction of balls grows by 0.0015 for every radian a second of the striking ball's sidespin."""
    world.ball_mu = _plus(world.ball_mu, lambda seen: 0.0015 * abs(seen.ball[6]))


def damp_end(world: World) -> None:
    """Rolling friction is higher by 0.35 of itself for every metre beyond x = 0.6 m."""
    world.roll = _times(world.roll, lambda seen: 1.0 + 0.35 * max(0.0, seen.ball[0] - 0.6))


def brushed_one_way(world: World) -> None:
    """Sliding friction is 1 + 0.15 cos(heading) times as high: the cloth is brushed along x."""
    world.slide = _times(world.slide, lambda seen: 1.0 + 0.15 * math.cos(_heading(seen)))


def dead_end(world: World) -> None:
    """The cushion at -x returns 0.07 less where y is above 0.2 m."""
    world.cushion_e = _plus(world.cushion_e, lambda seen: -0.07 if seen.rail == "-x" and seen.ball[1] > 0.2 else 0.0)


def sticky_when_new(world: World) -> None:
    """Friction of cushions is higher by 0.08 in the first third of the session."""
    world.cushion_mu = _plus(world.cushion_mu, lambda seen: 0.08 if seen.order < 1 / 3 else 0.0)


def dust_on_balls(world: World) -> None:
    """Friction of balls is higher by 0.06 exp(-approach / 0.8)."""
    world.ball_mu = _plus(world.ball_mu, lambda seen: 0.06 * math.exp(-seen.approach / 0.8))


def chipped_balls(world: World) -> None:
    """Balls return 0.05 less beyond 1.1 m/s of approach."""
    world.ball_e = _plus(world.ball_e, lambda seen: -0.05 if seen.approach > 1.1 else 0.0)


def evening_cloth(world: World) -> None:
    """Rolling friction grows by 0.03 of itself for every degree that the room is warmer, of which the clips tell."""
    world.roll = _times(world.roll, lambda seen: 1.0 + 0.03 * (seen.celsius - 20.0))


def pressed_seam(world: World) -> None:
    """Rolling friction is 1 + 0.8 exp(-(x / 0.15)^2) times as high: something lies below the middle of the cloth."""
    world.roll = _times(world.roll, lambda seen: 1.0 + 0.8 * math.exp(-((seen.ball[0] / 0.15) ** 2)))


def damp_edges(world: World) -> None:
    """Sliding friction is 1.3 times as high within 0.25 m of a long cushion."""
    world.slide = _times(
        world.slide, lambda seen: 1.3 if world.width / 2 - world.radius - abs(seen.ball[1]) < 0.25 else 1.0
    )


def bolted_rubber(world: World) -> None:
    """Long cushions return 0.04 cos(4 x) more, x in metres: they are bolted here and there."""
    world.cushion_e = _plus(
        world.cushion_e, lambda seen: 0.04 * math.cos(4.0 * seen.ball[0]) if seen.rail[1] == "y" else 0.0
    )


def greasy_cushions(world: World) -> None:
    """Friction of cushions is lower by 0.10 exp(-slip / 0.6)."""
    world.cushion_mu = _plus(world.cushion_mu, lambda seen: -0.10 * math.exp(-seen.slip / 0.6))


def warm_balls(world: World) -> None:
    """Friction of balls falls by 0.006 for every degree that the room is warmer, of which the clips tell."""
    world.ball_mu = _plus(world.ball_mu, lambda seen: -0.006 * (seen.celsius - 20.0))


def other_balls(world: World) -> None:
    """Balls return 0.05 less after three fifths of the session: others are played with."""
    world.ball_e = _plus(world.ball_e, lambda seen: -0.05 if seen.order > 0.6 else 0.0)


def sticky_crawl(world: World) -> None:
    """Rolling friction is 1 + 0.30 exp(-speed / 0.25) times as high: slow balls stop early."""
    world.roll = _times(world.roll, lambda seen: 1.0 + 0.30 * math.exp(-math.hypot(seen.ball[2], seen.ball[3]) / 0.25))


def worn_centre(world: World) -> None:
    """Sliding friction is 0.85 + 0.12 r^2 times as high, r in metres from the middle of the table."""
    world.slide = _times(world.slide, lambda seen: 0.85 + 0.12 * (seen.ball[0] ** 2 + seen.ball[1] ** 2))


def warming_rail(world: World) -> None:
    """The cushion at +x returns less from clip to clip, by 0.08 in all."""
    world.cushion_e = _plus(world.cushion_e, lambda seen: -0.08 * seen.order if seen.rail == "+x" else 0.0)


def biting_rubber(world: World) -> None:
    """Friction of cushions is higher by 0.10 (1 - exp(-approach / 0.8))."""
    world.cushion_mu = _plus(world.cushion_mu, lambda seen: 0.10 * (1.0 - math.exp(-seen.approach / 0.8)))


def saturating_throw(world: World) -> None:
    """Friction of balls is higher by 0.08 slip / (slip + 0.5)."""
    world.ball_mu = _plus(world.ball_mu, lambda seen: 0.08 * seen.slip / (seen.slip + 0.5))


def clinging_touch(world: World) -> None:
    """Friction of balls is higher by 0.08 below 0.7 m/s of approach."""
    world.ball_mu = _plus(world.ball_mu, lambda seen: 0.08 if seen.approach < 0.7 else 0.0)


def drying_cloth(world: World) -> None:
    """Rolling friction is 1 - 0.12 exp(-order / 0.25) times as high: the cloth dries in the session."""
    world.roll = _times(world.roll, lambda seen: 1.0 - 0.12 * math.exp(-seen.order / 0.25))


def brushed_pile(world: World) -> None:
    """Rolling balls are pushed across their way by 0.02 cos(heading) m/s^2: the pile of the cloth points along y."""
    world.across = lambda seen: 0.02 * math.cos(_heading(seen))


def spilled_water(world: World) -> None:
    """Rolling friction is 1.5 times as high where x is below -0.5 m, in the last 40 % of the session."""
    world.roll = _times(world.roll, lambda seen: 1.5 if seen.ball[0] < -0.5 and seen.order > 0.6 else 1.0)


def glancing_grip(world: World) -> None:
    """Friction of cushions is higher by 0.08 times the square of the sine of the angle of incidence."""
    world.cushion_mu = _plus(world.cushion_mu, lambda seen: 0.08 * math.sin(seen.incidence) ** 2)


def stiff_side(world: World) -> None:
    """The cushion at +y returns less by 0.04 for every m/s of approach."""
    world.cushion_e = _plus(world.cushion_e, lambda seen: -0.04 * seen.approach if seen.rail == "+y" else 0.0)


def rubbed_balls(world: World) -> None:
    """Balls return 0.05 less where they rub with more than 0.5 m/s of slip."""
    world.ball_e = _plus(world.ball_e, lambda seen: -0.05 if seen.slip > 0.5 else 0.0)


def damp_balls(world: World) -> None:
    """Friction of balls is higher by 0.003 times the square of the room's distance from 21 degrees."""
    world.ball_mu = _plus(world.ball_mu, lambda seen: 0.003 * (seen.celsius - 21.0) ** 2)


def slow_clock(world: World) -> None:
    """The camera's clock falls behind in the session: frames last longer by 0.4 % times the order."""
    world.frame *= 1.0 + 0.004 * world.order


def ironed_at_first(world: World) -> None:
    """Rolling friction falls along the table in the first half of the session, times 1 - 0.15 x."""
    world.roll = _times(world.roll, lambda seen: 1.0 - 0.15 * seen.ball[0] if seen.order < 0.5 else 1.0)


def woven_cloth(world: World) -> None:
    """Sliding friction is 1 + 0.12 cos(2 heading) times as high: the weave runs along x."""
    world.slide = _times(world.slide, lambda seen: 1.0 + 0.12 * math.cos(2.0 * _heading(seen)))


def cold_rails(world: World) -> None:
    """Cushions return 0.02 less for every degree below 20.5 of the room, of which the clips tell."""
    world.cushion_e = _plus(world.cushion_e, lambda seen: -0.02 * max(0.0, 20.5 - seen.celsius))


def scuffed_end(world: World) -> None:
    """The cushion at -x has 0.10 more friction where y is below -0.2 m."""
    world.cushion_mu = _plus(world.cushion_mu, lambda seen: 0.10 if seen.rail == "-x" and seen.ball[1] < -0.2 else 0.0)


def slick_touch(world: World) -> None:
    """Friction of balls is lower by 0.03 where they rub with less than 0.4 m/s of slip."""
    world.ball_mu = _plus(world.ball_mu, lambda seen: -0.03 if seen.slip < 0.4 else 0.0)


def ringing_balls(world: World) -> None:
    """Balls return 0.03 (approach - 1)^2 less, approach in m/s."""
    world.ball_e = _plus(world.ball_e, lambda seen: -0.03 * (seen.approach - 1.0) ** 2)


def trodden_way(world: World) -> None:
    """Rolling friction is 0.75 times as high within 0.25 m of the line y = 0.4 x: players shoot that way."""
    world.roll = _times(
        world.roll, lambda seen: 0.75 if abs(seen.ball[1] - 0.4 * seen.ball[0]) / math.hypot(1.0, 0.4) < 0.25 else 1.0
    )


def brushed_between(world: World) -> None:
    """Sliding friction is 0.82 times as high in the middle third of the session: the cloth was brushed, then ironed."""
    world.slide = _times(world.slide, lambda seen: 0.82 if 1 / 3 < seen.order < 2 / 3 else 1.0)


def loose_bolts(world: World) -> None:
    """The cushion at +x returns 0.08 less beyond 1.3 m/s of approach: its bolts give way."""
    world.cushion_e = _plus(world.cushion_e, lambda seen: -0.08 if seen.rail == "+x" and seen.approach > 1.3 else 0.0)


def tacky_noses(world: World) -> None:
    """Friction of the short cushions grows by 0.006 for every degree of the room, of which the clips tell."""
    world.cushion_mu = _plus(
        world.cushion_mu, lambda seen: 0.006 * (seen.celsius - 20.0) if seen.rail in ("+x", "-x") else 0.0
    )


def hollow_slate(world: World) -> None:
    """Balls return 0.06 less where they meet at x above 0.3 m: the slate gives there."""
    world.ball_e = _plus(world.ball_e, lambda seen: -0.06 if seen.ball[0] > 0.3 else 0.0)


def waxed_once(world: World) -> None:
    """Friction of balls is lower by 0.025 exp(-order / 0.3): the balls were waxed before the session."""
    world.ball_mu = _plus(world.ball_mu, lambda seen: -0.025 * math.exp(-seen.order / 0.3))


def linty_half(world: World) -> None:
    """Sidespin dies 1.5 times as fast where x is above 0.3 m."""
    world.spin = _times(world.spin, lambda seen: 1.5 if seen.ball[0] > 0.3 else 1.0)


def rubbed_chalk(world: World) -> None:
    """Sliding friction of the struck ball is 1 + 0.2 exp(-order / 0.4) times as high: its chalk is rubbed off."""
    world.slide = _times(
        world.slide, lambda seen: 1.0 + (0.2 * math.exp(-seen.order / 0.4) if seen.number == 0 else 0.0)
    )


def draughty_room(world: World) -> None:
    """Rolling balls are pushed to the left of their way by 0.015 m/s^2 in the second half of the session."""
    world.across = _plus(world.across, lambda seen: 0.015 if seen.order > 0.5 else 0.0)


def tired_stretch(world: World) -> None:
    """The cushion at -y returns 0.05 less between x = -0.6 and 0.2 m."""
    world.cushion_e = _plus(
        world.cushion_e, lambda seen: -0.05 if seen.rail == "-y" and -0.6 < seen.ball[0] < 0.2 else 0.0
    )


def slick_corners(world: World) -> None:
    """Friction of cushions falls by 0.08 for every radian of incidence beyond 0.5."""
    world.cushion_mu = _plus(world.cushion_mu, lambda seen: -0.08 * max(0.0, seen.incidence - 0.5))


def dusty_far_end(world: World) -> None:
    """Friction of balls is higher by 0.04 for every metre beyond x = 0."""
    world.ball_mu = _plus(world.ball_mu, lambda seen: 0.04 * max(0.0, seen.ball[0]))


def lossy_balls(world: World) -> None:
    """Balls return 0.08 approach / (approach + 1 m/s) less."""
    world.ball_e = _plus(world.ball_e, lambda seen: -0.08 * seen.approach / (seen.approach + 1.0))


def bumped_clock(world: World) -> None:
    """The camera's clock runs 0.4 % fast after the middle of the session."""
    world.frame = 0.996 if world.order > 0.5 else 1.0


PHYSICS: dict[str, Change] = {
    one.__name__: one
    for one in (
        *(worn_lane, slippery_at_speed, sidespin_on_rubber, warm_middle, chalk_gathers, soft_ball, warm_room),
        *(uneven_stretch, two_pieces, chalky_stretch, tired_rubber, soft_red, gripping_spin),
        *(damp_end, brushed_one_way, dead_end, sticky_when_new, dust_on_balls, chipped_balls, evening_cloth),
        *(pressed_seam, damp_edges, bolted_rubber, greasy_cushions, warm_balls, other_balls),
        *(sticky_crawl, worn_centre, warming_rail, biting_rubber, saturating_throw, clinging_touch, drying_cloth),
        *(brushed_pile, spilled_water, glancing_grip, stiff_side, rubbed_balls, damp_balls, slow_clock),
        *(ironed_at_first, woven_cloth, cold_rails, scuffed_end, slick_touch, ringing_balls),
        *(trodden_way, brushed_between, loose_bolts, tacky_noses, hollow_slate, waxed_once),
        *(linty_half, rubbed_chalk, draughty_room, tired_stretch, slick_corners, dusty_far_end, lossy_balls),
        *(bumped_clock,),
    )
}
WITH_TEMPERATURE = tuple(
    one.__name__ for one in (warm_room, evening_cloth, warm_balls, damp_balls, cold_rails, tacky_noses)
)
FAMILIES = (*PHYSICS, *PICTURES, "nothing")
