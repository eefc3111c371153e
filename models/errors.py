"""The exception for input that a user can correct: commands print it as one line and exit with status 2."""

MAX_LINE_CHARS = 400  # longest line of a message: a damaged file must not flood the screen
MAX_MESSAGE_CHARS = 580  # longest message with the places of several files


def one_line(text: str, most: int = MAX_LINE_CHARS) -> str:
    """The text as one printable line of limited length."""
    line = "".join(c if c.isprintable() else ascii(c)[1:-1] for c in text)
    if len(line) <= most:
        return line
    half = (most - 5) // 2  # the place comes first and the remedy last
    return f"{line[:half]} ... {line[-half:]}"


class BadInput(ValueError):
    """Input that cannot be used. The message names the offender, its value and the remedy, in one line."""

    def __init__(self, text: str) -> None:
        """Create the error; the text becomes one printable line, whatever names it contains."""
        super().__init__(one_line(text, MAX_MESSAGE_CHARS))
