"""The closed loop of planning, playing, filming and refitting; the history of a series and its report."""
