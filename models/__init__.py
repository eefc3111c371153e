"""The table as physics: effects, a world that plays them, and nothing of measurements."""
