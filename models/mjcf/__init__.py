"""The table and the launcher as MJCF: `base.xml`, `table.xml`, `launcher.xml`, and what is built and drawn from them.

world, native          table, balls and effects -> MjSpec -> MjModel; MuJoCo's own contact terms
furniture, snooker     what is only seen; spots and racks
export                 one plain MJCF file that needs no code of ours
launcher, stroke       the cue launcher, its strokes and its drive (launcher.md)
render, painter, gl    pictures, and the choice of OpenGL
"""
