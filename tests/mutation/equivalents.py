"""Mutants that change no observable where the model is valid: by name (mutants.Mutant.name), and why.

They are left out of the score, and counted beside it.
"""

EQUIVALENTS: dict[str, str] = {}
