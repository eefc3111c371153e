"""Selection: which effect a fit lacks; a named one, a formula for something else, or none.

In: a fit (sysid/estimation). Out: a `DiscoveryResult`: the ladder of models, the verdict, what stays unexplained, the
next shot.

    score              score test: predicted improvement of every candidate, before any is fitted
    screening          the candidates with the best scores fitted, ranked by evidence
    trials             where the fit of a candidate begins
    evidence           one fit against another; variance beyond noise
    free_forms         where something is missing: unknown functions by their marginal likelihood
    terms, formula     structure outside the catalogue, as a sparse formula; effect_file writes it as an effect
    judge              what whole shots name: an effect, a formula, or nothing
    by_windows         the same where not every whole shot is followed, by windows of one impact each
    departures         single shots that depart from the others
    pruning            effects that are no longer needed
    remainder          what neither effect nor formula explains
    stability          how often a verdict returns on other draws of the clips
    next_shot          the shot that separates two models best
    diagnose           one diagnosis, from clips
    discover           the whole loop
"""
