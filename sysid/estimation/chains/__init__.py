"""Multiple shooting: long shots as chains of windows, whose states end where the next one's begin.

In: the windows of shots (sysid/estimation/windows.py) and a model. Out: constants and states of all windows.

    chain         the windows of a shot and what holds them together, as one least-squares problem
    chain_fit     its constants and states; chain_search finds states from several beginnings
    chain_beside  the same for hundreds of further effects at a time, which are not fitted
"""
