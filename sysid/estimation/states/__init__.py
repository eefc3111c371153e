"""Initial states of shots at given constants.

In: a problem and a model. Out: position, velocity and spin of every ball that moves at the start.

    start_values    where initial states begin, and what is known of them before
    initial_states  refined from nearly right ones; how far shots scatter about their commands
    state_search    several optima of a shot, which live on from event to event
"""
