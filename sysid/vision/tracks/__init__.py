"""From sightings to shots: which ball is which, what rests and what moves, where a shot begins; then a clip set."""
