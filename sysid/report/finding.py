"""A fitted constant as a finding, and the line that is said of it."""

from __future__ import annotations

from dataclasses import dataclass

from models.model_file import Model

INTERVAL_SDS = 2.0  # to either side: 95 %
SIGNIFICANT_SDS = 3.0  # from zero, of what is usually zero
NOT_DETERMINED = "not determined by these clips"


@dataclass(frozen=True)
class HealthLine:
    """One constant beside typical values."""

    what: str  # the constant in plain words
    measured: str  # with its standard deviation and unit
    typical: str  # with its unit
    source: str
    verdict: str
    determined: bool  # whether the clips determine it well enough for a verdict
    beside: str = "typical"  # what it stands beside
    constant: str = ""  # its name in the model
    brief: str = ""  # for a headline, where measurement and verdict fit into a few words
    remedy: str = ""  # what to do at the table

    def text(self) -> str:
        """As one line, without the source."""
        return f"{self.what}: {self.measured} ({self.beside}: {self.typical}): {self.verdict}"


@dataclass(frozen=True)
class Finding:
    """A constant, its standard deviation, and the model that it belongs to."""

    value: float
    sd: float
    model: Model

    @property
    def significant(self) -> bool:
        """Whether it differs from zero."""
        return abs(self.value) > SIGNIFICANT_SDS * self.sd

    def narrower_than(self, width: float) -> bool:
        """Whether its interval is narrower than a range."""
        return 2 * INTERVAL_SDS * self.sd < width
