"""The table and the launcher as MJCF: `base.xml`, `table.xml`, `launcher.xml`, with builders and pictures.

world, native          table, balls and effects -> MjSpec -> MjModel; MuJoCo's own contact terms
furniture              purely visual parts
export                 a plain MJCF file that does not need our code
launcher, stroke       the cue launcher, its strokes and its drive (launcher.md)
render, painter, gl    pictures, and the choice of OpenGL
"""
