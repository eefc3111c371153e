"""Options of verbs: their types, decorators of those that several verbs share, and groups of them as one value."""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from models.commands.outputs import EFFECTS_KEY, JsonFile, OutputFile, ResultFile, ResultFolder
from models.errors import BadInput

Verb = TypeVar("Verb", bound=Callable[..., Any])
FILE_PATH = click.Path(path_type=Path)
OUTPUT_FILE, RESULT_FILE = OutputFile(), ResultFile()


@dataclasses.dataclass(frozen=True)
class Number(click.ParamType[float, str]):
    """A number within bounds; `above` excludes the lower one, `whole` asks for an integer."""

    low: float = -math.inf
    high: float = math.inf
    whole: bool = False
    above: bool = False
    unit: str = ""

    @property
    def name(self) -> str:  # type: ignore[override]
        """The name in help texts."""
        return "integer" if self.whole else "number"

    def convert(self, value: str | float, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Check the bounds; BadInput names the option, its value and the bounds."""
        option = param.opts[0] if param else "value"
        try:
            number = int(value) if self.whole else float(value)
        except ValueError:
            number = math.nan
        inside = self.low < number if self.above else self.low <= number
        if not inside or not number <= self.high or (math.isinf(number) and math.isinf(self.high)):
            raise BadInput(f"{option} {value}: give a{' whole' * self.whole} number{self._bounds()}")
        return number

    def _bounds(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        if math.isinf(self.low):
            return unit
        if math.isinf(self.high):
            return f" above {self.low:g}{unit}" if self.above else f" of {self.low:g}{unit} or more"
        return f" from {self.low:g} to {self.high:g}{unit}"


NON_NEGATIVE = Number(0, whole=True)
ABOVE_ZERO = Number(0, above=True)
ZERO_OR_MORE = Number(0)
ANY_NUMBER = Number()
json_option = click.option(
    "--json", "json_file", metavar="FILE", type=JsonFile(), help="Write the figures as JSON; - for standard output."
)


def out_option(metavar: str, text: str, **more: Any) -> Callable[[Verb], Verb]:
    """The option of a verb's main output file."""
    return click.option("--out", metavar=metavar, type=RESULT_FILE, help=text, **{"required": True} | more)


def out_folder_option(text: str, *writes: str, joined: Sequence[str] = (), **more: Any) -> Callable[[Verb], Verb]:
    """The option of a verb's main output folder, with patterns of the files written there (`ResultFolder`)."""
    kind = ResultFolder(*writes, joined=joined)
    return click.option("--out", metavar="DIR", type=kind, help=text, **{"required": True} | more)


def output_option(name: str, metavar: str, text: str) -> Callable[[Verb], Verb]:
    """The option of an additional output file: `--report` gives the parameter `report_file`."""
    return click.option(f"--{name}", f"{name}_file", metavar=metavar, type=OUTPUT_FILE, help=text)


def input_option(name: str, metavar: str, text: str, **more: Any) -> Callable[[Verb], Verb]:
    """The option of an input file: `--model` gives the parameter `model_file`."""
    return click.option(f"--{name}", f"{name}_file", metavar=metavar, type=FILE_PATH, help=text, **more)


def seed_option(default: int = 0) -> Callable[[Verb], Verb]:
    """The option of the seed of all random numbers."""
    text = "Seed of the random numbers."
    return click.option("--seed", metavar="N", type=NON_NEGATIVE, default=default, show_default=True, help=text)


scheduler_option = click.option(
    "--scheduler", metavar="ADDRESS",
    help="Address of a Dask scheduler whose workers compute (docs/cluster.md); by default this machine computes.",
)  # fmt: skip


def effects_option(*, exposed: bool = False) -> Callable[[Verb], Verb]:
    """The option of the user's own effects, which join the catalogue first; the verb gets the folders if `exposed`."""
    text = "Folder, or file, with your own effects; may be given more than once."
    return click.option(
        "--effects", "effect_folders", metavar="DIR", multiple=True, callback=_add_effects, expose_value=exposed,
        help=text,
    )  # fmt: skip


def _add_effects(ctx: click.Context, param: click.Parameter, folders: tuple[str, ...]) -> tuple[str, ...]:
    if folders and not ctx.resilient_parsing:
        from models.effect_catalogue import add_folder

        ctx.meta[EFFECTS_KEY] = [Path(folder) for folder in folders]
        for folder in folders:
            add_folder(folder)
    return folders


def given(
    option: str | Callable[[Any], Any], metavar: str = "", text: str = "", kind: Any = str, default: Any = None,
    **more: Any,
) -> Any:  # fmt: skip
    """A dataclass field filled by an option: a shared one, or one from flag, metavar, help, type and default."""
    shown = {"metavar": metavar or None, "help": text, "show_default": kind is not bool}
    if default is not None:  # a required option must have no default
        shown["default"] = default
    return dataclasses.field(default=default, metadata={"option": (option, kind, shown | more)})


def gathered(name: str, kind: type) -> Callable[[Verb], Verb]:
    """A group of options: a verb gets them under this name, as one value of a dataclass of `given` fields."""
    options: dict[str, Callable[[Any], Any]] = {}
    for field in dataclasses.fields(kind):
        option, type_, shown = field.metadata["option"]
        if isinstance(option, str):
            typed = {"is_flag": True} if type_ is bool else {"type": type_}
            option = click.option(option, field.name, **typed, **shown)
        options[field.name] = option

    def decorate(verb: Verb) -> Verb:
        @functools.wraps(verb)
        def call(*words: Any, **named: Any) -> Any:
            return verb(*words, **{name: kind(**{field: named.pop(field) for field in options})}, **named)

        decorated: Any = call
        for option in reversed(options.values()):
            decorated = option(decorated)
        return decorated

    return decorate


def at_most_one(**given: object) -> None:
    """Raise BadInput for options that exclude each other, named by their parameters."""
    named = [f"--{name.replace('_', '-')}" for name, value in given.items() if value]
    if len(named) > 1:
        raise BadInput(f"{' and '.join(named)} exclude each other; give one of them")
