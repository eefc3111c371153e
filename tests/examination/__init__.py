"""Clip sets to be examined by: a generator that shares no code with the models, with sysid or with tests/truth.

In: a family of hidden causes, a seed, a folder. Out: a clip set, and what is hidden in it beside the folder.

Balls move in steps of a fifth of a millisecond; impulses of contacts are added up in steps of the normal impulse
(Mathavan, Jackson and Parkin, 2010 and 2014). `python -m tests.examination FOLDER` makes a set of every family.
"""
