"""The verbs of the `sysid` command as functions, as `from sysid import fit` imports them.

In: a `ClipSet`, and a start `Model` or a result with one; by default the base (decoupled cloth, frictional impacts).
Out: the results of the packages below, frozen values, which here also print as short tables, convert to data frames and
write a report. The commands call the same functions.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

from models.commands.console import Progress
from models.errors import BadInput
from models.files import made_folder
from models.files.faults import listed, shown
from models.interface import HasModel, model_of
from models.messages import counted
from models.mjcf.export import places_of
from models.model_file import Model, full_model, write_model
from models.report.numbers import SDS_OF_95_PERCENT, millimetres, number
from models.report.sheet import Picture, Presented, Sheet, frame_of
from sysid.clips import ClipSet
from sysid.clips.choose import chosen_clip
from sysid.estimation.clip_fit import ClipFit, fit_clips
from sysid.mjcf.table import PlainTable, plain_table
from sysid.prepare import prepare
from sysid.report.findings import labelled_models, round_rows, shot_lines, verdict_lines
from sysid.report.html import write_report
from sysid.report.outcome import compared_ends, compared_with_formula, write_discovery, write_outcome
from sysid.report.pictures.plot import shot_figure
from sysid.report.text import in_words, summary_lines, worst_rows
from sysid.report.verdict import verdict_of
from sysid.residuals.compare import compare as compare_clips
from sysid.residuals.comparison import Comparison
from sysid.selection.diagnose import ClipDiagnosis
from sysid.selection.diagnose import diagnose as diagnose_clips
from sysid.selection.discover import discover as discover_effects
from sysid.selection.judgement import ERROR_RATE
from sysid.selection.result import DiscoveryResult, Show

CALLED_FROM = "sysid.discover"  # the origin that model files state
Result = TypeVar("Result")


def _as(kind: type[Result], found: Any, **more: Any) -> Result:
    """A result of a package below, extended by its inputs."""
    return kind(**{f.name: getattr(found, f.name) for f in dataclasses.fields(found)}, **more)


@dataclass(frozen=True, repr=False, eq=False)
class ComparedClips(Presented, Comparison):
    """A comparison; prints medians and the worst clips."""

    def sheet(self) -> Sheet:
        """A table of the worst clips; the data frame has all."""
        columns = {f.name: [getattr(c, f.name) for c in self.clips] for f in dataclasses.fields(self.clips[0])}
        heads, *rows = worst_rows(self)
        return Sheet(columns, heads, tuple(rows), tuple(summary_lines(self)))

    def report(self, path: Path | str, label: str = "this model") -> None:
        """Write the report, one HTML file; BadInput if it cannot be written."""
        title = f"Model against {counted(len(self.clips), 'clip')}"
        write_report(path, title, [(label, self)], notes=in_words(self))

    def sample_frame(self) -> Any:
        """A data frame with a row for every sample: measured position, and the model's error [m]."""
        s = self.samples
        columns: dict[str, Any] = {"clip": [self.clips[int(k)].file for k in s.clip], "ball": s.ball, "time": s.time}
        columns |= {"x": s.xy[:, 0], "y": s.xy[:, 1], "miss_x": s.residual[:, 0], "miss_y": s.residual[:, 1]}
        columns |= {"speed": s.speed, "motion": s.motion, "last_event": s.last, "events": s.events}
        return frame_of(columns)

    def plot(self, clip: int | str | None = None) -> Picture:
        """One shot from above with the model's tracks, speeds, and misses over time.

        Args:
            clip: its file, or its number from 1; by default the shot that the model misses most.
        """
        file = max(self.clips, key=lambda row: row.rms_m).file
        if clip is not None:
            file = chosen_clip(self.clip_set, str(clip), self.clip_set.folder).file
        files = [shot.file for shot in self.shots]
        if file not in files:
            raise BadInput(f"{file}: is not part of the comparison; choose one of {listed(files)}")
        k = files.index(file)
        drawn = shot_figure(self.shots[k], self.clip_set.table, self.clip_set.ball, [("model", self.tracks[k])])
        return Picture(f"shot {file}", *drawn)


@dataclass(frozen=True, repr=False, eq=False)
class FittedClips(Presented, ClipFit):
    """A fit; prints the constants with their intervals."""

    clips: ClipSet = dataclasses.field(kw_only=True)

    def sheet(self) -> Sheet:
        """A table of every constant with its 95 % interval."""
        columns: dict[str, list[Any]] = {name: [] for name in ("constant", "value", "sd", "low", "high", "unit")}
        rows = []
        for name, (value, sd) in self.constants.items():
            low, high, unit = (
                value - SDS_OF_95_PERCENT * sd,
                value + SDS_OF_95_PERCENT * sd,
                self.model.meta(name)["unit"],
            )
            for column, entry in zip(columns.values(), (name, value, sd, low, high, unit), strict=True):
                column.append(entry)
            digits = max(0, 1 - math.floor(math.log10(sd))) if math.isfinite(sd) and sd > 0 else 5
            interval = f"{low:.{digits}f} to {high:.{digits}f}" if math.isfinite(sd) else "-"
            rows.append((name, f"{value:.{digits}f}", interval, unit))
        used, held = len(self.parts.training.clips), self.parts.held_out
        line = (
            f"{used} clips, rms miss {millimetres(self.fitted.miss)}; {len(held.clips) if held else 0} held out, "
            f"{millimetres(self.fitted.held_miss)}; noise {millimetres(self.parts.noise)} an axis"
        )
        doubt = () if self.converged else ("NOT converged: the constants are those where the fit stopped",)
        return Sheet(columns, ("constant", "value", "95 % interval", "unit"), tuple(rows), (line, *doubt))

    @cached_property
    def comparison(self) -> ComparedClips:
        """The comparison of the fitted model with all clips."""
        states = self.parts.states_of(self.fitted, [c.file for c in self.clips.clips])
        return _as(ComparedClips, compare_clips(self.clips, self.model, states))

    def report(self, path: Path | str) -> None:
        """Write the report, one HTML file; BadInput if it cannot be written."""
        self.comparison.report(path, "fitted")

    def save(self, path: Path | str) -> None:
        """Write the model file; BadInput if it cannot be written."""
        write_model(self.model, path)


@dataclass(frozen=True, repr=False, eq=False)
class DiagnosedClips(Presented, ClipDiagnosis):
    """A diagnosis; prints the candidates and the verdict."""

    clips: ClipSet = dataclasses.field(kw_only=True)

    def sheet(self) -> Sheet:
        """A table of the candidates, best first."""
        seen = self.diagnosis.screening
        heads, *rows = round_rows(seen)
        columns: dict[str, list[Any]] = {
            "candidate": [one.name for one in seen.fits],
            "delta_bic": [one.evidence.delta_bic for one in seen.fits],
            "miss_m": [one.fitted.miss for one in seen.fits],
            "held_out_miss_m": [one.fitted.held_miss for one in seen.fits],
            "converged": [one.converged for one in seen.fits],
        }
        return Sheet(columns, heads, tuple(rows), tuple(verdict_lines(self.diagnosis, self.unexplained)))

    @cached_property
    def comparison(self) -> ComparedClips:
        """The comparison of the diagnosed model with all clips."""
        states = self.parts.states_of(self.fitted, [c.file for c in self.clips.clips])
        return _as(ComparedClips, compare_clips(self.clips, self.fitted.model, states))

    def report(self, path: Path | str, notes: Sequence[str] | None = None) -> None:
        """Write the report, one HTML file; BadInput if it cannot be written."""
        lines = [*self.sheet().lines, *shot_lines(self.next_shots)] if notes is None else notes
        rounds = (self.diagnosis.screening,)
        compared = [("base", self.comparison)]
        write_report(path, "What is missing", compared, notes=lines, rounds=rounds, next_shots=self.next_shots)


@dataclass(frozen=True, repr=False, eq=False)
class Discovery(Presented, DiscoveryResult):
    """A discovery; prints its verdict, a headline first."""

    clips: ClipSet = dataclasses.field(kw_only=True)

    def sheet(self) -> Sheet:
        """The verdict, a headline first; the data frame has the ladder of models."""
        models = labelled_models(self)
        columns: dict[str, list[Any]] = {
            "model": [name for name, _ in models],
            "miss_m": [fitted.miss for _, fitted in models],
            "held_out_miss_m": [fitted.held_miss for _, fitted in models],
            "chi2_reduced": [fitted.chi2 for _, fitted in models],
        }
        return Sheet(columns, (), (), verdict_of(self).lines())

    def _repr_html_(self) -> str:
        """The verdict and, in a notebook, the ladder below it."""
        rows = [
            (name, millimetres(fitted.miss), millimetres(fitted.held_miss), number(fitted.chi2))
            for name, fitted in labelled_models(self)
        ]
        heads = ("model", "rms miss", "held out", "reduced χ²")
        return dataclasses.replace(self.sheet(), heads=heads, rows=tuple(rows)).html()

    @cached_property
    def compared(self) -> list[tuple[str, Comparison]]:
        """Labelled comparisons of the first and the last model with all clips, then of the last with its formula."""
        ends = compared_ends(self.clips, self, CALLED_FROM)
        return [*ends, *compared_with_formula(self.clips, self, CALLED_FROM)]

    def report(self, path: Path | str) -> None:
        """Write the report, one HTML file; BadInput if it cannot be written."""
        write_discovery(path, self.clips, self, self.compared)

    def save(self, folder: Path | str) -> None:
        """Write model.toml, result.json, report.html and review.rrd into a folder, which is created."""
        write_outcome(made_folder(folder), self.clips, self, Progress(), math.nan, CALLED_FROM)


def compare(clips: ClipSet, model: Model | HasModel | None = None) -> ComparedClips:
    """Compare a model with clips: initial states are fitted, constants are held."""
    return _as(ComparedClips, compare_clips(clips, _start(clips, model)))


def fit(clips: ClipSet, model: Model | HasModel | None = None) -> FittedClips:
    """Fit every constant of a model, with its standard deviation; every fifth clip is held out."""
    return _as(FittedClips, fit_clips(clips, _start(clips, model)), clips=clips)


def diagnose(clips: ClipSet, model: Model | HasModel | None = None, error_rate: float = ERROR_RATE) -> DiagnosedClips:
    """Diagnose which effect of the catalogue a model lacks, if any."""
    return _as(DiagnosedClips, diagnose_clips(clips, _start(clips, model), error_rate), clips=clips)


def discover(
    clips: ClipSet, model: Model | HasModel | None = None, show: Show = lambda found: None,
    error_rate: float = ERROR_RATE,
) -> Discovery:  # fmt: skip
    """Fit, diagnose and add effects until nothing likely remains; `show` is called with the result after each."""
    return _as(Discovery, discover_effects(clips, _start(clips, model), show, error_rate), clips=clips)


def export(
    model: Model | HasModel, path: Path | str, *, balls: Sequence[str] | Mapping[str, Any] | None = None,
    launcher: bool = False, bare: bool = False, origin: str = "",
) -> PlainTable:  # fmt: skip
    """Write a model as plain MJCF for any MuJoCo, without our code; returns what the file leaves out.

    Args:
        model: a model, or a result that has one.
        path: of the file.
        balls: names, or places (2,) [m] by name, the struck ball first; by default a snooker frame.
        launcher: with the cue launcher behind the first ball.
        bare: without purely visual parts.
        origin: where the model comes from, for the head of the file.

    Raises:
        BadInput: for invalid balls, or a file that cannot be written.
    """
    own = model_of(model).as_played()
    places = balls if isinstance(balls, Mapping) else places_of(own, balls)
    table = plain_table(own, places, launcher=launcher, bare=bare, origin=origin)
    table.save(path)
    return table


def _start(clips: ClipSet, model: Model | HasModel | None) -> Model:
    """The given model, or the base for this table; announces and does any compilation first."""
    if not isinstance(clips, ClipSet):
        raise BadInput(f"clips is {shown(clips)}: give a clip set, such as sysid.read_clips(FOLDER)")
    start = full_model(clips.table, clips.ball) if model is None else model_of(model)
    prepare()
    return start
