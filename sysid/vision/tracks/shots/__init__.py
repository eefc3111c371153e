"""From moves to shots: strikes, motion without one, spins in place; where a path breaks, and what is in no shot."""
