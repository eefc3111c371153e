"""Shots planned in a fitted model: scenes, strokes and their errors, the search, plans, reports and studies."""
