"""What comes of a stroke on a fitted model: outcomes, their utility, and both under execution errors."""
