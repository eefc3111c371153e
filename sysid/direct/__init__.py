"""Friction and restitution measured directly from tracks, each by its own method, without simulator or common fit.

In: a clip set. Out: `Measurements`, the paper's direct measurements with their uncertainty. In the order of imports:

    slide_roll    a slide and a roll, fitted to the positions of one ball
    deceleration  even deceleration of a path length or an angle
    measured      one figure from many values: random effects, robust
    friction      sliding, rolling, spinning
    at_impact     motion right before and right after an impact
    ball_impact   restitution of the balls
    cushion       restitution and friction of the cushion
    measure       all of them: `sysid measure`
"""
