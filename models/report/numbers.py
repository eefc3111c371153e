"""Numbers as reports show them; a dash where there is none."""

from __future__ import annotations

import math

NO_VALUE = "–"
SDS_OF_95_PERCENT = 1.96  # half width of a 95 % interval, in standard deviations


def number(value: float | None) -> str:
    """Three digits, a count whole, thousands apart; – where there is no number."""
    if value is None or not math.isfinite(value):
        return NO_VALUE
    if abs(value) >= 100 or isinstance(value, int):
        return f"{value:,.0f}".replace(",", "\u202f") if abs(value) >= 9999.5 else f"{value:.0f}"
    return f"{value:#.3g}" if abs(value) >= 0.01 else f"{value:.3g}"


def millimetres(metres: float | None) -> str:
    """A length [m] in mm, to three digits."""
    return NO_VALUE if metres is None or not math.isfinite(metres) else f"{number(1e3 * metres)} mm"


def value_with_sd(value: float, sd: float) -> str:
    """Value ± standard deviation, to two digits of the latter; – for one that was not computed."""
    if not math.isfinite(value):
        return NO_VALUE
    if not math.isfinite(sd) or sd <= 0:
        return f"{value:.5g} ± {NO_VALUE}"
    digits = max(0, 1 - math.floor(math.log10(sd)))
    return f"{value:.{digits}f} ± {sd:.{digits}f}" if digits <= 9 else f"{value:.6g} ± {sd:.2g}"
