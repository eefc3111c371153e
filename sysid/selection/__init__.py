"""Which effect is missing: named, or a formula for something else, or nothing.

In: a fit (sysid/estimation). Out: a `Discovery`: the ladder of models, the verdict, what is left, the next shot.

    score          every candidate beside all that is active, before any is fitted
    screening      the most promising ones fitted, ranked by evidence
    evidence       one fit against another; what a fit leaves beyond noise
    runs, judge    runs between impacts where whole shots are not followed; whom to believe
    terms, formula structure outside the catalogue, as a sparse formula
    remainder      what neither explains
    next_shot      the shot that would tell two models apart
    discover       the whole loop
"""
