"""What the cue gives the struck ball beyond the commanded velocity and spin: squirt, and the hop off the slate."""
