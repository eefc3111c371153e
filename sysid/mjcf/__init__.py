"""A model as plain MJCF, for any MuJoCo, without our code.

In: a `Model`. Out: a `PlainTable`: the text of a file, and what it leaves out, in mm.

    said        effects that MJCF can express: slope, noses, rails, the struck ball
    player      shots played from such a file by MuJoCo alone
    terms       MuJoCo's own contact terms, fitted to the model
    costs       the error of what is left out, by cause
    table       the file
"""
