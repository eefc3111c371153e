"""The table that `mj_step` moves: balls under MuJoCo's own contacts, cloth and effects as generalised forces.

layout     where MuJoCo's structs hold what a compiled callback reads and writes
step       which contacts act, and how long the next step may be
forces     what that callback does: cloth, effects, friction at impacts
passive    the callback itself, installed once
noses      the rails as geoms
world      `World`: a model of a table as an MjModel; balls placed, struck, and left to `mj_step`
launcher   the cue launcher in a world; drive: one stroke of it, step by step
"""
