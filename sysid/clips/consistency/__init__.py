"""Whether the tracks of a clip set go with its entries: coordinates, times, sizes, commands, marks, the strike.

In: a `ClipSet`. Out: `Contradiction`s, each with the typical values that show it and its remedy.

    strike           when the struck ball sets off, and whether it is the one
    readings, units  coordinates and times in other units, from elsewhere, along other axes
    contradictions   what the tracks of a set contradict: diameter, table; commands (aims), times (tempo), marks
"""
