"""The event engine: whole shots with every effect, compiled. Models and shots go in, tracks or ends of shots come out."""
