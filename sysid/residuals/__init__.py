"""Comparison of model and measurement: where the model's errors occur, and what they depend on.

In: a clip set and a model. Out: a `Comparison`. From the top down:

    compare, comparison     errors of every clip and segment; the result as values
    segment_fits            segments between events with their initial states
    collect, samples        residuals of every sample, with the ball's state
    groups, bins            errors by phase, event, speed, place and so on
    accelerations, impacts  missing accelerations between events, and missing velocities after impacts
    localise, significance  the significant departures; sentences puts them into words
    functions               what is lacking, as smooth functions of place, speed, spin and the order of clips
    whiteness               whether the residuals are noise
"""
