"""Search for strokes: geometric candidates, the search over them, and the published method as a baseline."""
