"""Test footage with known truth: `python -m tests.footage` films the clip sets of the independent generator."""
