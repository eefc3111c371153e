"""Figures of reports: ladders, errors, maps of the table, shots that are played back.

In: a `Comparison`, `Lacking`, `NextShot`s. Out: `Chart`s, shapes that a template draws, PNG.
"""
