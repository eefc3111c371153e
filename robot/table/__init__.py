"""Strokes at a real table: a person puts the ball back, the launcher at its port strikes, a camera films."""
