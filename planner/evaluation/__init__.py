"""Evaluation of strokes on a fitted model: outcomes, their utility, and both under execution errors."""
