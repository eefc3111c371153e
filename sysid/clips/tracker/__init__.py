"""What a tracker and its camera add to the motion of balls: noise, slow errors, outliers, the scale of time.

In: a `ClipSet`. Out: standard deviations and factors, and the set without misplaced samples.
"""
