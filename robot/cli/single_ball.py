"""Shared by `campaign` and `repeat`, which strike the cue ball alone on a real table many times."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import click

from models.commands.options import ABOVE_ZERO, FILE_PATH, given
from models.errors import BadInput
from models.files import scratch_folder
from robot.cli.common import Filming, Wire, confirmed, set_up, yes_option

if TYPE_CHECKING:
    from robot.device.settings import Settings
    from robot.table.single_ball import SingleBall


@dataclass(frozen=True)
class AtTable:
    """Options of a single ball on a real table, with the launcher behind it."""

    end: str | None = given(
        "--end", "END", "End of the table behind which the launcher stands, -x or +x; by default -x.",
        click.Choice(("-x", "+x")),
    )  # fmt: skip
    tolerance: float | None = given(
        "--tolerance", "MM", "Tolerance of the position to which the ball is put back [mm]; by default 2.", ABOVE_ZERO
    )
    films: Path | None = given(
        "--films", "DIR", "Folder to keep the recordings; by default each is deleted once evaluated.", FILE_PATH
    )
    yes: bool = given(yes_option, default=False)

    def refuse(self) -> None:
        """Raise BadInput without a real table."""
        for name, value in (("end", self.end), ("tolerance", self.tolerance), ("films", self.films)):
            if value:
                raise BadInput(f"--{name} requires a launcher at a --port; omit it, or name the port")

    @contextmanager
    def ball(self, wire: Wire, filming: Filming, settings: Settings) -> Iterator[SingleBall]:
        """The table with its camera open; without any question or motion yet."""
        from robot.table.single_ball import PLACE_TOLERANCE_M, SingleBall, place_of

        tolerance = PLACE_TOLERANCE_M if self.tolerance is None else 1e-3 * self.tolerance
        with scratch_folder() as passing:
            folder = passing / "films"

            def clear() -> None:
                if not self.films:
                    shutil.rmtree(folder, ignore_errors=True)

            with filming.open(self.films or folder) as camera:
                place, azimuth = place_of(camera.table, self.end or "-x")
                yield SingleBall(
                    camera, lambda: wire.launcher(settings), place, azimuth,
                    lambda action: self.yes or confirmed(action, "the stand is aligned"), set_up,
                    tolerance=tolerance, clear=clear,
                )  # fmt: skip

    def print_needs(self, wire: Wire, filming: Filming, rig: SingleBall, strokes: int) -> None:
        """Print the needs of a measurement with a number of strokes."""
        from robot.table.placing import words_of

        wire.print_needs(
            filming.need,
            f"{words_of(rig.table, 'the cue ball', rig.place)}, alone on the table; the place marked, since it is put "
            f"back there {'once' if strokes == 1 else f'{strokes} times'}, within {1e3 * rig.tolerance:g} mm",
            f"the stand behind it at the {self.end or '-x'} end, the cue along the table",
            yes=self.yes,
        )
