"""Model against measurement: where and on what the error depends, in figures.

In: a clip set and a model. Out: a `Comparison`. From the top down:

    compare, comparison     errors of every clip and segment; the result as values
    segment_fits            segments between events with their initial states
    collect, samples        residuals sample by sample, with the state of the ball there
    groups, bins            errors by phase, event, speed, place and so on
    accelerations, impacts  what the model lacks between events, and at impacts
    localise, significance  the few departures that are significant; sentences puts them in words
    whiteness               whether the residuals are noise
"""
