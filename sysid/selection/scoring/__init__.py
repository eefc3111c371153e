"""How likely an additional cause is, before it is fitted and after.

In: a fit, and what it may lack. Out: `Scores` of candidates, and losses of one fit beside another.

    signatures   candidates, and how the residuals would change with a little of each
    score        the fall of the loss that each promises, jointly with constants and initial states
    evidence     losses of shots about two fits, and what they leave beyond the noise
"""
