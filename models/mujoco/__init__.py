"""The table that `mj_step` moves: balls under MuJoCo's own contacts, cloth and effects as generalised forces.

layout     where MuJoCo's structs hold what a compiled callback reads and writes
forces     that callback: cloth, effects, friction at impacts, step sizes
world      `World`: a model of a table as an MjModel; balls placed, struck, and left to `mj_step`
"""
