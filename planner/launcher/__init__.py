"""The planner's model of the launcher: strokes, execution errors, and the map from commands to the ball's motion."""
