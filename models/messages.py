"""Messages that name an option: `--fps F` on the command line, `fps=F` in Python.

A message is text with `Option`s in it; whoever prints it chooses the spelling. The text of an `OptionError` has that of
the command line.
"""

from __future__ import annotations

import json
from dataclasses import dataclass

from models.errors import BadInput


@dataclass(frozen=True)
class Option:
    """An option of a command, and the argument of the function that does the same."""

    command: str  # such as --x-along length|width
    python: str  # such as x_along="length"|"width"


def option(argument: str, *values: str) -> Option:
    """The option of an argument, with the texts to choose from; without any, its name alone."""
    name = f"--{argument.replace('_', '-')}"
    if not values:
        return Option(name, argument)
    return Option(f"{name} {'|'.join(values)}", f"{argument}={'|'.join(map(json.dumps, values))}")


@dataclass(frozen=True)
class MessageParts:
    """A line for the user: text, and the options that it names."""

    parts: tuple[str | Option, ...]

    def for_command(self) -> str:
        """The line with options as on the command line."""
        return "".join(part if isinstance(part, str) else part.command for part in self.parts)

    def for_python(self) -> str:
        """The line with arguments in place of options."""
        return "".join(part if isinstance(part, str) else part.python for part in self.parts)


class OptionError(BadInput):
    """Input that cannot be used unless an option is given or changed."""

    def __init__(self, *parts: str | Option) -> None:
        """Create the error from the parts of its message."""
        self.message = MessageParts(parts)
        super().__init__(self.message.for_command())


def counted(count: int, noun: str) -> str:
    """A number of things: 1 ball, 0 balls, 3 balls."""
    return f"{count} {noun}{'' if count == 1 else 's'}"
