"""Statistics of plans over many random scenes with a hidden truth."""
