"""A fit as the search of causes sees it, of whole shots or of windows of one impact each.

In: a fit. Out: its `FitView`: scores, fits with a cause more or less, and losses beside those of another.

    view              what the search needs of a fit
    by_whole_shots    of whole shots, which the model follows
    by_windows        of windows of one impact each, where it does not
"""
