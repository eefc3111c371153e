"""The camera over the table: it films shots as they are played and finds the direction of the cue."""
