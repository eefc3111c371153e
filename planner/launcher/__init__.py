"""What a launcher can play: strokes, their execution errors, and the map from what it is sent to what the ball does."""
