"""What acts on a ball between impacts: friction of the cloth, drag, slope, nap, an uneven ball."""
