"""All direct measurements of a clip set: friction and restitution, each by its own method.

In: a clip set. Out: `Measurements`: every constant that the clips determine on its own.

After Mathavan, Jackson, Parkin 2009 and Robotic Billiards (2015) section III; the methods are described in friction.py,
ball_impact.py and cushion.py. Left out: accelerations of a ball besides the cloth's friction (a constant one across the
path is allowed for), contact times.
"""

from __future__ import annotations

import logging
import math

from models.shot import GRAVITY
from sysid.clips import ClipSet
from sysid.clips.segments import split_all
from sysid.clips.tracker.noise import position_noise
from sysid.clips.tracker.outliers import remove_outliers
from sysid.direct.at_impact import Known
from sysid.direct.ball_impact import BALL_RESTITUTION, collisions
from sysid.direct.cushion import cushion, rebounds
from sysid.direct.friction import MIN_SAMPLES, ROLL_FRICTION, SLIDE_FRICTION, SPIN_FRICTION, rolling, sliding, spinning
from sysid.direct.measured import Measured, Measurements, combine
from sysid.direct.slide_roll import LN_ROLL, LN_SLIDE, WIDE_PRIOR, ParameterPrior, segment_motions

# Value and relative sd of a friction that is not measured, and the least relative sd of a measured one.
USUAL_SLIDE, MIN_SLIDE_SD = (0.2, 0.3), 0.02
USUAL_ROLL, MIN_ROLL_SD = (0.0127, 0.5), 0.1
log = logging.getLogger(__name__)


def measure(clip_set: ClipSet) -> Measurements:
    """Measure every constant that the clips determine on its own."""
    sigma = position_noise(clip_set)
    clip_set, spikes = remove_outliers(clip_set, sigma)
    frame, files = 1 / clip_set.fps, [c.file for c in clip_set.clips]
    log.info("slide and roll of every segment")
    segments = split_all(clip_set.clips, clip_set.table, clip_set.ball, sigma, clip_set.fps, MIN_SAMPLES + 1)
    found = segment_motions(segments, sigma, frame)
    slide = combine(SLIDE_FRICTION, sliding(found, files))
    roll = combine(ROLL_FRICTION, rolling(found, files, sigma))
    log.info("sidespin")
    spin = combine(SPIN_FRICTION, spinning(clip_set, sigma))
    prior = _prior(slide, roll)
    known = Known(sigma, frame, prior, math.exp(float(prior[0][LN_SLIDE])) / GRAVITY)
    notes = () if slide.value else ("mu_s is not measured here; 0.2 +- 0.06 is assumed at impacts",)
    log.info("impacts")
    ball = combine(BALL_RESTITUTION, collisions(found, clip_set, known), notes)
    three = cushion(rebounds(found, clip_set, known), clip_set.ball, known.cloth, notes)
    return Measurements(len(files), sigma, spikes, (slide, roll, spin, ball, *three))


def _prior(slide: Measured, roll: Measured) -> ParameterPrior:
    """Prior of the motion before and after impacts, with measured frictions or else usual ones."""
    mean, sd = WIDE_PRIOR[0].copy(), WIDE_PRIOR[1].copy()
    for k, one, usual, least in (
        (LN_SLIDE, slide, USUAL_SLIDE, MIN_SLIDE_SD),
        (LN_ROLL, roll, USUAL_ROLL, MIN_ROLL_SD),
    ):
        value, wide = (one.value, math.hypot(one.sd or 0.0, one.scatter) / one.value) if one.value else usual
        mean[k], sd[k] = math.log(value * GRAVITY), max(wide, least)
    return mean, sd
