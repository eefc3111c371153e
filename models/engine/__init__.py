"""The event engine: whole shots with every effect, compiled: models and shots in, tracks or ends of shots out."""
