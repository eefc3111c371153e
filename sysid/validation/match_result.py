"""One error of a model against a reference, with its tolerance: as a value, a line of text and an entry of a file."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class MatchResult:
    """One error of a model against a reference."""

    case: str
    model: str  # "native" or "effects"
    error: float
    unit: str
    tolerance: float | None = None
    analytic: float | None = None  # the error of the analytic model, where it has one

    @property
    def ok(self) -> bool:
        """Whether the error is within its tolerance; True without one."""
        return self.tolerance is None or self.error <= self.tolerance


def line(row: MatchResult) -> str:
    """A result as a line of text."""
    tolerance = "" if row.tolerance is None else f"  tolerance {row.tolerance:g} {row.unit}"
    analytic = "" if row.analytic is None else f"  (analytic {row.analytic:.3g})"
    exceeded = "" if row.ok else ": EXCEEDED"
    return f"{row.case:79} {row.model:8} {row.error:9.3g} {row.unit:3}{analytic}{tolerance}{exceeded}"


def to_json(row: MatchResult) -> dict[str, object]:
    """A result as an entry of the JSON file."""
    return {
        "case": row.case, "model": row.model, "error": row.error, "unit": row.unit, "reach": row.tolerance,
        "analytic": row.analytic, "ok": row.ok,
    }  # fmt: skip
