"""Selection: which effect a fit lacks; a named one, a formula for something else, or none.

In: a fit (sysid/estimation). Out: a `DiscoveryResult`: the ladder of models, the verdict, what stays unexplained, the
next shot.

    score              score test: predicted improvement of every candidate, before any is fitted
    free_forms         causes, named or not, by their marginal likelihood; unknown functions
    terms, formula     structure outside the catalogue, as a sparse formula; effect_file writes it as an effect
    view               a fit beside which causes are looked for: by_windows, by_whole_shots
    search             one cause after another added, and what becomes needless dropped
    screening          a round of it, as reports show it
    evidence           one fit against another; variance beyond noise
    departures         single shots that depart from the others
    remainder          what neither effect nor formula explains
    stability          how often a verdict returns on other draws of the clips
    next_shot          the shot that separates two models best
    diagnose           one diagnosis, from clips
    discover           the whole loop
"""
