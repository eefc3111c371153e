"""Families of hidden causes in how balls meet cushions and each other."""

from __future__ import annotations

import math

from tests.examination.laws import plus
from tests.examination.motion import Seen, World


def sidespin_on_rubber(world: World) -> None:
    """A cushion returns less by 0.0012 for every radian a second of sidespin."""
    world.cushion_e = plus(world.cushion_e, lambda seen: -0.0012 * abs(seen.ball[6]))


def warm_middle(world: World) -> None:
    """The long cushions return 0.08 less beyond 0.9 m from their middle."""
    world.cushion_e = plus(
        world.cushion_e, lambda seen: -0.08 if seen.rail[1] == "y" and abs(seen.ball[0]) > 0.9 else 0.0
    )


def chalk_gathers(world: World) -> None:
    """Friction between balls grows from clip to clip, by 0.10 in all."""
    world.ball_mu = plus(world.ball_mu, lambda seen: 0.10 * seen.order)


def soft_ball(world: World) -> None:
    """Balls return 0.15 exp(-approach / 0.5) less: slow collisions lose most."""
    world.ball_e = plus(world.ball_e, lambda seen: -0.15 * math.exp(-seen.approach / 0.5))


def warm_room(world: World) -> None:
    """Cushions return 0.006 more for every degree that the room is warmer, of which the clips tell."""
    world.cushion_e = plus(world.cushion_e, lambda seen: 0.006 * (seen.celsius - 20.0))


def chalky_stretch(world: World) -> None:
    """The cushion at +y has 0.10 more friction between x = -0.9 and 0.3 m."""
    world.cushion_mu = plus(
        world.cushion_mu, lambda seen: 0.10 if seen.rail == "+y" and -0.9 < seen.ball[0] < 0.3 else 0.0
    )


def tired_rubber(world: World) -> None:
    """A cushion returns less by 0.06 for every m/s of approach beyond 1.2 m/s."""
    world.cushion_e = plus(world.cushion_e, lambda seen: -0.06 * max(0.0, seen.approach - 1.2))


def soft_red(world: World) -> None:
    """The red ball comes back from cushions with 0.06 less restitution."""
    world.cushion_e = plus(world.cushion_e, lambda seen: -0.06 if seen.number == 1 else 0.0)


def gripping_spin(world: World) -> None:
    """Friction of balls grows by 0.0015 for every radian a second of the striking ball's sidespin."""
    world.ball_mu = plus(world.ball_mu, lambda seen: 0.0015 * abs(seen.ball[6]))


def dead_end(world: World) -> None:
    """The cushion at -x returns 0.07 less where y is above 0.2 m."""
    world.cushion_e = plus(world.cushion_e, lambda seen: -0.07 if seen.rail == "-x" and seen.ball[1] > 0.2 else 0.0)


def sticky_when_new(world: World) -> None:
    """Friction of cushions is higher by 0.08 in the first third of the session."""
    world.cushion_mu = plus(world.cushion_mu, lambda seen: 0.08 if seen.order < 1 / 3 else 0.0)


def dust_on_balls(world: World) -> None:
    """Friction of balls is higher by 0.06 exp(-approach / 0.8)."""
    world.ball_mu = plus(world.ball_mu, lambda seen: 0.06 * math.exp(-seen.approach / 0.8))


def chipped_balls(world: World) -> None:
    """Balls return 0.05 less beyond 1.1 m/s of approach."""
    world.ball_e = plus(world.ball_e, lambda seen: -0.05 if seen.approach > 1.1 else 0.0)


def bolted_rubber(world: World) -> None:
    """Long cushions return 0.04 cos(4 x) more, x in metres: they are bolted here and there."""
    world.cushion_e = plus(
        world.cushion_e, lambda seen: 0.04 * math.cos(4.0 * seen.ball[0]) if seen.rail[1] == "y" else 0.0
    )


def greasy_cushions(world: World) -> None:
    """Friction of cushions is lower by 0.10 exp(-slip / 0.6)."""
    world.cushion_mu = plus(world.cushion_mu, lambda seen: -0.10 * math.exp(-seen.slip / 0.6))


def warm_balls(world: World) -> None:
    """Friction of balls falls by 0.006 for every degree that the room is warmer, of which the clips tell."""
    world.ball_mu = plus(world.ball_mu, lambda seen: -0.006 * (seen.celsius - 20.0))


def other_balls(world: World) -> None:
    """Balls return 0.05 less after three fifths of the session: others are played with."""
    world.ball_e = plus(world.ball_e, lambda seen: -0.05 if seen.order > 0.6 else 0.0)


def warming_rail(world: World) -> None:
    """The cushion at +x returns less from clip to clip, by 0.08 in all."""
    world.cushion_e = plus(world.cushion_e, lambda seen: -0.08 * seen.order if seen.rail == "+x" else 0.0)


def biting_rubber(world: World) -> None:
    """Friction of cushions is higher by 0.10 (1 - exp(-approach / 0.8))."""
    world.cushion_mu = plus(world.cushion_mu, lambda seen: 0.10 * (1.0 - math.exp(-seen.approach / 0.8)))


def saturating_throw(world: World) -> None:
    """Friction of balls is higher by 0.08 slip / (slip + 0.5)."""
    world.ball_mu = plus(world.ball_mu, lambda seen: 0.08 * seen.slip / (seen.slip + 0.5))


def clinging_touch(world: World) -> None:
    """Friction of balls is higher by 0.08 below 0.7 m/s of approach."""
    world.ball_mu = plus(world.ball_mu, lambda seen: 0.08 if seen.approach < 0.7 else 0.0)


def glancing_grip(world: World) -> None:
    """Friction of cushions is higher by 0.08 times the square of the sine of the angle of incidence."""
    world.cushion_mu = plus(world.cushion_mu, lambda seen: 0.08 * math.sin(seen.incidence) ** 2)


def stiff_side(world: World) -> None:
    """The cushion at +y returns less by 0.04 for every m/s of approach."""
    world.cushion_e = plus(world.cushion_e, lambda seen: -0.04 * seen.approach if seen.rail == "+y" else 0.0)


def rubbed_balls(world: World) -> None:
    """Balls return 0.05 less where they rub with more than 0.5 m/s of slip."""
    world.ball_e = plus(world.ball_e, lambda seen: -0.05 if seen.slip > 0.5 else 0.0)


def damp_balls(world: World) -> None:
    """Friction of balls is higher by 0.003 times the square of the room's distance from 21 degrees."""
    world.ball_mu = plus(world.ball_mu, lambda seen: 0.003 * (seen.celsius - 21.0) ** 2)


def cold_rails(world: World) -> None:
    """Cushions return 0.02 less for every degree below 20.5 of the room, of which the clips tell."""
    world.cushion_e = plus(world.cushion_e, lambda seen: -0.02 * max(0.0, 20.5 - seen.celsius))


def scuffed_end(world: World) -> None:
    """The cushion at -x has 0.10 more friction where y is below -0.2 m."""
    world.cushion_mu = plus(world.cushion_mu, lambda seen: 0.10 if seen.rail == "-x" and seen.ball[1] < -0.2 else 0.0)


def slick_touch(world: World) -> None:
    """Friction of balls is lower by 0.03 where they rub with less than 0.4 m/s of slip."""
    world.ball_mu = plus(world.ball_mu, lambda seen: -0.03 if seen.slip < 0.4 else 0.0)


def ringing_balls(world: World) -> None:
    """Balls return 0.03 (approach - 1)^2 less, approach in m/s."""
    world.ball_e = plus(world.ball_e, lambda seen: -0.03 * (seen.approach - 1.0) ** 2)


def loose_bolts(world: World) -> None:
    """The cushion at +x returns 0.08 less beyond 1.3 m/s of approach: its bolts give way."""
    world.cushion_e = plus(world.cushion_e, lambda seen: -0.08 if seen.rail == "+x" and seen.approach > 1.3 else 0.0)


def tacky_noses(world: World) -> None:
    """Friction of the short cushions grows by 0.006 for every degree of the room, of which the clips tell."""
    world.cushion_mu = plus(
        world.cushion_mu, lambda seen: 0.006 * (seen.celsius - 20.0) if seen.rail in ("+x", "-x") else 0.0
    )


def hollow_slate(world: World) -> None:
    """Balls return 0.06 less where they meet at x above 0.3 m: the slate gives there."""
    world.ball_e = plus(world.ball_e, lambda seen: -0.06 if seen.ball[0] > 0.3 else 0.0)


def waxed_once(world: World) -> None:
    """Friction of balls is lower by 0.025 exp(-order / 0.3): the balls were waxed before the session."""
    world.ball_mu = plus(world.ball_mu, lambda seen: -0.025 * math.exp(-seen.order / 0.3))


def tired_stretch(world: World) -> None:
    """The cushion at -y returns 0.05 less between x = -0.6 and 0.2 m."""
    world.cushion_e = plus(
        world.cushion_e, lambda seen: -0.05 if seen.rail == "-y" and -0.6 < seen.ball[0] < 0.2 else 0.0
    )


def slick_corners(world: World) -> None:
    """Friction of cushions falls by 0.08 for every radian of incidence beyond 0.5."""
    world.cushion_mu = plus(world.cushion_mu, lambda seen: -0.08 * max(0.0, seen.incidence - 0.5))


def dusty_far_end(world: World) -> None:
    """Friction of balls is higher by 0.04 for every metre beyond x = 0."""
    world.ball_mu = plus(world.ball_mu, lambda seen: 0.04 * max(0.0, seen.ball[0]))


def lossy_balls(world: World) -> None:
    """Balls return 0.08 approach / (approach + 1 m/s) less."""
    world.ball_e = plus(world.ball_e, lambda seen: -0.08 * seen.approach / (seen.approach + 1.0))


def hard_corners(world: World) -> None:
    """Cushions return 0.05 more within 0.3 m of a corner."""

    def harder(seen: Seen) -> float:
        half, at = (world.width, seen.ball[1]) if seen.rail[1] == "x" else (world.length, seen.ball[0])
        return 0.05 if half / 2 - abs(at) < 0.3 else 0.0

    world.cushion_e = plus(world.cushion_e, harder)


def slipping_noses(world: World) -> None:
    """Friction of cushions falls by 0.05 for every m/s of slip beyond 0.8 m/s."""
    world.cushion_mu = plus(world.cushion_mu, lambda seen: -0.05 * max(0.0, seen.slip - 0.8))


def glancing_balls(world: World) -> None:
    """Balls return 0.03 less for every m/s of slip: what glances loses more."""
    world.ball_e = plus(world.ball_e, lambda seen: -0.03 * seen.slip)


def spun_cling(world: World) -> None:
    """Friction of balls is higher by 0.05 where the striking ball has more than 25 rad/s of sidespin."""
    world.ball_mu = plus(world.ball_mu, lambda seen: 0.05 if abs(seen.ball[6]) > 25.0 else 0.0)


def greased_long_noses(world: World) -> None:
    """Friction of the long cushions is lower by 0.05 after the middle of the session."""
    world.cushion_mu = plus(world.cushion_mu, lambda seen: -0.05 if seen.rail[1] == "y" and seen.order > 0.5 else 0.0)


def glancing_noses(world: World) -> None:
    """Cushions return 0.06 less where a ball comes in at more than 0.9 radians from their normal."""
    world.cushion_e = plus(world.cushion_e, lambda seen: -0.06 if seen.incidence > 0.9 else 0.0)


def brittle_balls(world: World) -> None:
    """Balls return 0.05 less between 0.8 and 1.6 m/s of approach."""
    world.ball_e = plus(world.ball_e, lambda seen: -0.05 if 0.8 < seen.approach < 1.6 else 0.0)


def dusty_sides(world: World) -> None:
    """Friction of balls is higher by 0.15 y^2, y in metres from the middle of the table."""
    world.ball_mu = plus(world.ball_mu, lambda seen: 0.15 * seen.ball[1] ** 2)


def worn_end_nose(world: World) -> None:
    """Friction of the cushion at -x falls by 0.06 for every m/s of slip beyond 0.5 m/s."""
    world.cushion_mu = plus(
        world.cushion_mu, lambda seen: -0.06 * max(0.0, seen.slip - 0.5) if seen.rail == "-x" else 0.0
    )


def waking_rubber(world: World) -> None:
    """Cushions return 0.06 exp(-order / 0.3) less: cold rubber wakes up in the session."""
    world.cushion_e = plus(world.cushion_e, lambda seen: -0.06 * math.exp(-seen.order / 0.3))


def sticky_cuts(world: World) -> None:
    """Friction of balls is higher by 0.05 where less than 0.6 of the striking ball's speed is approach."""
    world.ball_mu = plus(
        world.ball_mu, lambda seen: 0.05 if seen.approach < 0.6 * math.hypot(seen.ball[2], seen.ball[3]) else 0.0
    )


def sweating_slate(world: World) -> None:
    """Balls return 0.05 less where y is below 0, in the second half of the session."""
    world.ball_e = plus(world.ball_e, lambda seen: -0.05 if seen.ball[1] < 0.0 and seen.order > 0.5 else 0.0)
