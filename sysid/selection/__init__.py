"""Selection: which effect a fit lacks; a named one, a formula for something else, or none.

In: a fit (sysid/estimation). Out: a `DiscoveryResult`: the ladder of models, the verdict, what stays unexplained, the
next shot.

    score              score test: predicted improvement of every candidate, before any is fitted
    screening          the candidates with the best scores fitted, ranked by evidence
    evidence           one fit against another; variance beyond noise
    runs               segments between impacts, where whole shots are not followed; confirmation by whole shots
    terms, formula     structure outside the catalogue, as a sparse formula; effect_file writes it as an effect
    judge              one diagnosis: an effect, a formula, or nothing
    remainder          what neither explains
    next_shot          the shot that separates two models best
    discover           the whole loop
"""
