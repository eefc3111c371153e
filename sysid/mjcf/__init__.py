"""A model as plain MJCF, for any MuJoCo and without code of ours.

In: a `Model`. Out: a `PlainTable`: the text of a file, and what it leaves out, in mm.

    said        what MJCF says of effects: slope, noses, rails, the struck ball
    player      shots in such a file, moved by MuJoCo alone
    terms       MuJoCo's own contact terms, fitted to the model
    costs       what that leaves out, by cause
    table       the file
"""
