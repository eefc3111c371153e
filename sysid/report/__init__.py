"""What people read and see: text on the terminal, the HTML report and its plots, result.json, the recording.

In: a `Comparison` or a `Discovery`. `pictures` makes the figures. Only `recording` knows Rerun. `health` judges a
fitted model by `typical` values.
"""
