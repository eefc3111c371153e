"""The launcher as the planner sees it: strokes, execution errors, and the map from commands to the ball's motion."""
