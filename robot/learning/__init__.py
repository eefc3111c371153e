"""The closed loop: plan, play, film, refit; the history of a series and its report."""
