"""Model against measurement: where and on what the error depends, in figures.

In: a clip set and a model. Out: a `Comparison`.

    compare, comparison     every clip and segment held against the model; the figures of that
    collect, samples        what the model missed, sample by sample
    groups, bins            errors by phase, event, speed, place and so on
    accelerations, impacts  what balls lack between events, and at them
    localise, significance  the few departures worth naming
    whiteness               whether what is left is noise
"""
