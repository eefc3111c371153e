"""Random shots inside everything that a user may ask for, and what no physics gives: `python -m tests.random_shots`.

draws       models, effects and constants within their bounds; balls on the cloth, spread out, racked, frozen
laws        what no shot may do: not a number, a ball outside the noses or inside another, energy from nothing
"""
