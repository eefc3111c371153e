"""Friction and restitution straight from tracks, each by a method of its own: no simulator, no common fit.

In: a clip set. Out: `Measurements`, the paper's direct measurements with their uncertainty.
"""
