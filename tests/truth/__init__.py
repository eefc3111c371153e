"""Tracked clips with known truth, made by an independent simulation.

The data tests the models, so nothing here imports them: own integrator on the cloth (`cloth`), own impulse
integration at impacts (`impact`), a whole shot (`physics`), random shots (`shots`), what a camera makes of them
(`camera`), the files (`write`). What can be hidden in them is named in `effects`, with natural sizes in `sizes`.
"""
