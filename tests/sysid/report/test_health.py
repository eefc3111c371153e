"""The table's health: verdicts where the clips support them, silence where they do not."""

from __future__ import annotations

import dataclasses
import math
import re
from dataclasses import dataclass
from pathlib import Path

import pytest

from models.effect import Effect, param
from models.effect_catalogue import catalogue
from models.effects.camera.image_scale import ImageScale
from models.effects.cloth.table_tilt import TableTilt
from models.effects.cloth.worn_patch import WornPatch
from models.effects.impact.nose_height import NoseHeight, NoseHeightPy
from models.model_file import Estimate, Model, full_model
from models.shot import Ball, Table
from sysid.report.finding import NOT_DETERMINED
from sysid.report.health import NOT_CONVERGED_LINE, health, health_lines
from sysid.report.html import write_report
from sysid.report.judges import JUDGES
from sysid.report.typical import AT_FAST_SLIP, AT_LOW_SPEED, AT_ONE_METRE_PER_SECOND, TYPICAL_RANGES
from tests.support.comparison_samples import comparison

TABLE, BALL = Table(3.569, 1.778), Ball(0.0525, 0.1406)


def report_of(model: Model, folder: Path) -> str:
    """The report of a model that is compared with a few clips."""
    write_report(folder / "report.html", "a table", [("it", dataclasses.replace(comparison(1), model=model))])
    return (folder / "report.html").read_text()


def fitted(effects: tuple[Effect, ...] = (), *, converged: bool = True, **found: tuple[float, float]) -> Model:
    """The base model and effects, with values and standard deviations of `effect__parameter`."""
    model = full_model(TABLE, BALL)
    model = dataclasses.replace(model, effects=(*model.effects, *effects))
    named = {key.replace("__", "."): pair for key, pair in found.items()}
    model = model.with_values({name: value for name, (value, _) in named.items()})
    estimates = {name: Estimate(sd if converged else float("nan"), "test") for name, (_, sd) in named.items()}
    return dataclasses.replace(model, estimates=estimates, fitted={"converged": converged})


def test_a_slope_names_the_end_to_raise_and_by_how_much() -> None:
    # downhill towards +y by 1.7 mm in a metre: over 1.778 m the end lies 3.0 mm low
    model = fitted((TableTilt(),), table_tilt__slope_x=(-0.0001, 1e-5), table_tilt__slope_y=(0.0017, 2e-5))
    along_x, along_y = health(model)
    assert along_y.text() == (
        "slope along y: 1.700 ± 0.020 mm/m (typical: up to 0.4 mm/m): downhill towards +y: raise that end by 3.0 mm"
    )
    assert along_x.verdict == "level, as fitters aim at"


def test_a_slope_that_the_clips_do_not_tell_has_no_verdict() -> None:
    lines = health_lines(fitted((TableTilt(),), table_tilt__slope_y=(0.0017, 0.0003)))
    assert lines == [f"{NOT_DETERMINED}: slope along y"]


@pytest.mark.parametrize(
    ("roll", "says"), [(0.0045, "very fast: "), (0.0051, "fast: "), (0.0127, "of ordinary speed: "), (0.02, "slow: ")]
)
def test_the_cloth_s_speed_and_how_far_a_ball_rolls(roll: float, says: str) -> None:
    (line,) = health(fitted(decoupled_cloth__roll=(roll, 1e-5)))
    assert line.verdict == f"{says}a ball that rolls at 1 m/s runs {1 / (2 * 9.81 * roll):.1f} m"
    assert line.measured.startswith(f"{9.81 * roll:.4f}"[:5])


@pytest.mark.parametrize("name", TYPICAL_RANGES)
def test_a_range_judges_only_what_is_known_better_than_the_range(name: str) -> None:
    usual = TYPICAL_RANGES[name]
    effect = () if name.startswith(("decoupled", "ball_im", "cushion_im")) else (catalogue()[name.split(".")[0]](),)
    width = usual.high - usual.low
    key = name.replace(".", "__")
    middle = usual.low + 0.4 * width  # not where an effect is off
    assert usual.source
    assert health(fitted(effect, **{key: (middle, width / 10)}))[0].determined
    assert not health(fitted(effect, **{key: (middle, width / 3)}))[0].determined
    for value, words in ((usual.low - 0.2 * width, usual.below), (usual.high + 0.2 * width, usual.above)):
        assert health(fitted(effect, **{key: (value, width / 100)}))[0].verdict.startswith(words)


def test_a_fit_that_did_not_converge_says_nothing(tmp_path: Path) -> None:
    model = fitted((TableTilt(),), converged=False, table_tilt__slope_y=(0.0017, 2e-5))
    assert health(model) == []
    assert health_lines(model) == [NOT_CONVERGED_LINE]
    assert NOT_CONVERGED_LINE in report_of(model, tmp_path)


def test_a_model_that_was_not_fitted_has_no_health(tmp_path: Path) -> None:
    model = full_model(TABLE, BALL)
    assert health_lines(model) == []
    assert "as usual" not in report_of(model, tmp_path)


def test_the_report_shows_typical_values_with_their_source(tmp_path: Path) -> None:
    page = report_of(fitted(ball_impact__restitution=(0.95, 0.001)), tmp_path)
    assert "Mathavan 2014: 0.89" in page
    assert "0.9500 ± 0.0010" in page
    strip = re.search(r'class="strip"><s style="left:([\d.]+)%;width:([\d.]+)%"></s><i style="left:([\d.]+)%', page)
    assert strip is not None
    start, width, low = map(float, strip.groups())
    assert low == pytest.approx(start + width * (0.948 - 0.89) / 0.09, abs=0.2), (
        "where 0.948 lies between 0.89 and 0.98"
    )


@dataclass(frozen=True)
class CushionRestitutionMx(Effect):
    """One cushion's own restitution, as the catalogue has it by this name."""

    change: float = param(-0.04, off=0.0, unit="1", bounds=(-0.5, 0.2), source="test")


@pytest.mark.parametrize(
    ("change", "sd", "says"),
    [
        (-0.04, 0.005, "returns 5 % less of a ball's speed than the others"),
        (0.02, 0.004, "returns 2.5 % more"),
        (-0.04, 0.02, NOT_DETERMINED),
    ],
)
def test_one_cushion_beside_the_others(change: float, sd: float, says: str) -> None:
    (line,) = health(
        fitted(
            (CushionRestitutionMx(),), cushion_restitution_mx__change=(change, sd), cushion_impact__restitution=(0.8, 0)
        )
    )
    assert line.what.startswith("cushion -x")
    assert says in line.verdict


def test_noses_stand_as_high_as_they_do_and_sizes_know_it() -> None:
    """A lower nose meets the ball further out, which is no error of the table's width."""
    nearer = (math.sqrt(1 - 0.27**2) - math.sqrt(1 - 0.4**2)) * BALL.diameter
    found = {"nose_height__change": (-0.13, 0.001), "table__width": (TABLE.width - nearer, 1e-4)}
    lines = health_lines(fitted((NoseHeight(),), **found))
    assert lines[0].startswith("cushions, height of the noses: 1.2700 ± 0.0010 R") and "33.3 mm above" in lines[0]
    assert lines[1] == "table, width from nose to nose: 1.77800 ± 0.00010 m (stated: 1.778 m): as stated"


def test_one_nose_beside_the_others() -> None:
    (line,) = health(fitted((NoseHeightPy(),), nose_height_py__change=(-0.06, 0.005)))
    assert line.verdict == "cushion +y stands 1.6 mm lower than the others: check its bolts and shims"
    assert health(fitted((NoseHeightPy(),), nose_height_py__change=(0.06, 0.05)))[0].verdict == NOT_DETERMINED


def test_a_worn_patch_is_named_by_its_place() -> None:
    patch = WornPatch(x=0.55, y=-0.2, radius=0.35)
    place = {"worn_patch__x": (0.55, 0.01), "worn_patch__y": (-0.2, 0.01), "worn_patch__radius": (0.35, 0.02)}
    (line,) = health(fitted((patch,), worn_patch__roll=(0.9, 0.01), **place))
    assert line.verdict.startswith("within 0.35 m of x = 0.55, y = -0.20 m rolling balls slow down 90 % more")
    assert health(fitted((patch,), worn_patch__roll=(-0.1, 0.1), **place))[0].verdict == NOT_DETERMINED
    anywhere = place | {"worn_patch__y": (-0.2, math.nan)}
    assert health(fitted((patch,), worn_patch__roll=(0.9, 0.01), **anywhere))[0].verdict == NOT_DETERMINED


def test_the_camera_s_scale_names_the_height_of_the_balls_where_that_explains_it() -> None:
    def verdict(stretch: float) -> str:
        return health(fitted((ImageScale(),), image_scale__stretch=(stretch, 1e-4)))[0].verdict

    assert "height of the balls' centres" in verdict(0.01)
    assert "length and width" in verdict(0.03)
    assert "length and width" in verdict(-0.01)


def test_every_name_is_one_of_the_catalogue() -> None:
    names = {f"{effect}.{key}" for effect, kind in catalogue().items() for key in kind.parameters()}
    assert set(TYPICAL_RANGES) | set(JUDGES) <= names
    changed = AT_FAST_SLIP | AT_LOW_SPEED | AT_ONE_METRE_PER_SECOND
    assert set(changed) <= names
    assert set(changed.values()) <= set(catalogue())


def test_a_table_that_was_measured_wrong_is_told_in_plain_words() -> None:
    sizes = {"table.length": (3.5583, 4e-4), "table.width": (1.7785, 4e-4), "ball.diameter": (0.0525, 2.5e-4)}
    lines = health_lines(fitted(**{name.replace(".", "__"): pair for name, pair in sizes.items()}))
    assert lines == [
        "table, length from nose to nose: 3.55830 ± 0.00040 m (stated: 3.569 m): 10.7 mm less than stated: measure it "
        "again, and correct length in clips.toml; if the stated length is right, the camera's scale is off by 0.3 %: "
        "calibrate it again",
        "table, width from nose to nose: 1.77850 ± 0.00040 m (stated: 1.778 m): as stated",
        f"{NOT_DETERMINED}: balls, diameter",
    ]
