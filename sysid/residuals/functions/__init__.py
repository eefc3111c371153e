"""What a model lacks as smooth functions: of the place on the cloth, and of speed, slip, spin, angle and order.

In: accelerations and impacts of a comparison. Out: `Lacking`: functions with their uncertainty.
"""
