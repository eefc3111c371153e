"""A fit as the search of causes sees it: scores, fits with a cause more or less, and gains of one over another.

view              what the search needs of a fit
by_whole_shots    of whole shots, which the model follows
by_windows        of windows of one impact each, where it does not
"""
