"""How balls and cushions collide: restitution, friction and the masses that meet."""
