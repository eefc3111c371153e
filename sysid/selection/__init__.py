"""Selection of what a fit lacks: a named effect, a formula for something else, or nothing.

In: a fit (sysid/estimation). Out: a `DiscoveryResult`: the ladder of models, the verdict, unexplained structure, the
next shots.

    score              score test: predicted improvement by every candidate, before any is fitted
    free_forms         causes, named or not, by their marginal likelihood; unknown functions
    terms, formula     structure outside the catalogue, as a sparse formula; effect_file writes it as an effect
    view               the interface of a fit for the search: by_windows, by_whole_shots
    search             adds one cause after another, and drops redundant ones; shaping: the shapes of unknown functions
    screening          the result of a round, for reports
    evidence           comparison of two fits; variance beyond noise
    departures         single shots that depart from the others
    remainder          what neither effect nor formula explains
    stability          how often a verdict is reproduced on resampled clips
    next_shot          the shot that separates two models best
    diagnose           one diagnosis, from clips
    discover           the whole loop
"""
