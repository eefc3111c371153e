"""Verbs that identify a model: check, measure, compare, fit, plot; and what it leaves out: diagnose, discover, demo."""
