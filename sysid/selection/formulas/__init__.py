"""What is in no catalogue: unknown functions, their shapes, and formulas of these.

In: a fit, and scores of candidates. Out: `SparseFormula`s to fit, their description for result.json, and effect files.

    free_forms             quantities as unknown functions of what their hooks see, and how likely each is
    factors, terms         the terms of formulas, as codes and as text; terms_read reads them from a result
    families, shapes       groups of terms that a function may be, and the likeliest of them
    formula                a sum of shapes that grows by one at a time
    description            what a result says of it; effect_file writes it as an effect
"""
