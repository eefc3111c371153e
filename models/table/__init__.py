"""What a table and its balls are, as plain values: sizes by name, pockets as measured, spots, colours.

pocket_shape     mouth, nose, facings and slate of pockets, one shape for the corners and one for the middles
presets          tables and balls by name
sizes            which sizes of table and ball a fit may correct
snooker          the dimensions of snooker, its spots and its rack
palette          colours of table and balls
"""
