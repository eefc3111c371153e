"""What the verbs share that strike the cue ball alone on a real table, again and again: `campaign` and `repeat`."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from models.command_line import ABOVE_ZERO, FILE_PATH, given
from models.errors import BadInput
from models.files import scratch_folder
from robot.cli.common import Filming, Wire, confirmed, set_up, yes_option

if TYPE_CHECKING:
    from robot.device.settings import Settings
    from robot.table.lone_ball import LoneBall


@dataclass(frozen=True)
class AtTable:
    """A ball alone on a real table, and the launcher behind it."""

    end: str | None = given(
        "--end", "END", "End of the table behind which the launcher stands, -x or +x; by default -x.",
        click.Choice(("-x", "+x")),
    )  # fmt: skip
    tolerance: float | None = given(
        "--tolerance", "MM", "Tolerance of the ball that is put back [mm]; by default 2.", ABOVE_ZERO
    )
    films: Path | None = given(
        "--films", "DIR", "Keep the recordings there; by default none is kept once it was read.", FILE_PATH
    )
    yes: bool = given(yes_option, default=False)

    def refuse(self) -> None:
        """BadInput without a real table."""
        for name, value in (("end", self.end), ("tolerance", self.tolerance), ("films", self.films)):
            if value:
                raise BadInput(f"--{name} belongs to a launcher at a --port; leave it out, or name the port")

    @contextmanager
    def ball(self, wire: Wire, filming: Filming, settings: Settings) -> Iterator[LoneBall]:
        """The table with its camera open; nothing is asked for or moved yet."""
        from robot.table.lone_ball import PLACE_TOLERANCE_M, LoneBall, place_of

        tolerance = PLACE_TOLERANCE_M if self.tolerance is None else 1e-3 * self.tolerance
        with scratch_folder() as passing:
            folder = passing / "films"

            def clear() -> None:
                if not self.films:
                    shutil.rmtree(folder, ignore_errors=True)

            with filming.open(self.films or folder) as camera:
                place, azimuth = place_of(camera.table, self.end or "-x")
                yield LoneBall(
                    camera, lambda: wire.launcher(settings), place, azimuth,
                    lambda action: self.yes or confirmed(action, "the stand is aligned"), set_up,
                    tolerance=tolerance, clear=clear,
                )  # fmt: skip

    def print_needs(self, wire: Wire, filming: Filming, rig: LoneBall, strokes: int) -> None:
        """Say what a measurement of so many strokes needs."""
        from robot.table.placing import words_of

        wire.print_needs(
            filming.need,
            f"{words_of(rig.table, 'the cue ball', rig.place)}, alone on the table; the place marked, since it is put "
            f"back there {'once' if strokes == 1 else f'{strokes} times'}, within {1e3 * rig.tolerance:g} mm",
            f"the stand behind it at the {self.end or '-x'} end, the cue along the table",
            yes=self.yes,
        )
