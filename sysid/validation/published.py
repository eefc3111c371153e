"""Published measurements for comparison with models of impacts.

Cushion: a rolling ball straight at the rail of a snooker table, speed before and after [m/s]. Mathavan, Jackson and
Parkin 2010, Fig. 7(a), and 2009, Fig. 9, read off the figures to about 0.01 m/s; the two share shots.
Ball on ball: a rolling cue ball, speed [m/s] and cut [degrees]; speeds [m/s] once both balls roll and the cue ball's
deflection [degrees]. The same authors 2009, Table I; speeds to 0.011 m/s.
"""

from __future__ import annotations

CUSHION_2010 = (
    (0.263, 0.234), (0.355, 0.324), (0.418, 0.383), (0.651, 0.583), (0.704, 0.665), (0.845, 0.791), (1.154, 1.069),
    (1.299, 1.237), (1.526, 1.456), (1.755, 1.645), (1.991, 1.824), (2.276, 2.031), (2.530, 2.280), (2.701, 2.265),
    (2.893, 2.383), (2.985, 2.462), (3.106, 2.620), (3.185, 2.568), (3.405, 2.732),
)  # fmt: skip
CUSHION_2009 = (
    (0.273, 0.217), (1.515, 1.453), (1.761, 1.638), (1.989, 1.822), (2.280, 2.033), (2.530, 2.282), (2.703, 2.261),
    (3.404, 2.737),
)  # fmt: skip
OBLIQUE_2009 = (  # speed, cut, cue ball after, object ball after, deflection of the cue ball
    (1.539, 33.83, 0.816, 0.836, 35.96),
    (1.032, 26.36, 0.520, 0.629, 33.20),
    (1.364, 40.52, 0.925, 0.700, 30.50),
    (1.731, 46.50, 1.275, 0.787, 27.97),
    (0.942, 18.05, 0.365, 0.581, 29.86),
)
