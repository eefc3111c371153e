"""The colours of balls, and their names by them: groups of colours, faces, how likely each name is."""
