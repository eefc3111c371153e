"""Strokes at a real table: a person puts the ball back, the launcher strikes it, and a camera films it."""
