"""From a scene to strokes: candidates by geometry, the search over them, and the published method beside it."""
