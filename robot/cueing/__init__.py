"""Ball speed and squirt of strokes: campaigns, the cueing map fitted to them, and its report."""
