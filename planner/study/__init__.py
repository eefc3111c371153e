"""How plans fare over many random scenes with a hidden truth."""
