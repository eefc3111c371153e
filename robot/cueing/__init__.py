"""From strokes to ball speed and squirt: campaigns, the cueing map fitted to them, and its report."""
