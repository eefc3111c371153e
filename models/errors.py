"""The one exception for input that a user can mend: commands print it as one line and exit with status 2."""


class BadInput(ValueError):
    """Input that cannot be used. The message names the offender, its value and the remedy, in one line."""
