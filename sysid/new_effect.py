"""A user's own effect: a file to fill in that runs as it is, with its test beside it."""

from __future__ import annotations

import json
import keyword
import re
from pathlib import Path
from typing import Any

from models.errors import BadInput
from models.files import write_whole
from models.model_file import catalogue
from sysid.structure import source_from

TEMPLATE = '''"""{title}: say in one line what it is.

Acceleration -rate v of a rolling ball: state the formula here, with its source, and what it leaves out.
Replace this example, which is a rolling resistance that grows with the speed, by your own.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from models.effect import Array, Balls, Effect, column, param

STEP = 0.2  # a force that changes along the way is taken at the middle of steps of at most this length [s]


@dataclass(frozen=True)
class {cls}(Effect):
    """Deceleration in proportion to speed."""

    # Every parameter: its usual value, the value at which it vanishes, unit, bounds, and where these come from.
    # It is one number, or an (nsim,) array with a value for every simulation.
    rate: float = param(0.01, off=0.0, unit="1/s", bounds=(-0.1, 0.2), source="replace: where these come from")

    varies: ClassVar[bool] = True  # the force changes along a step; without this line it is taken at its beginning
    # slot: ClassVar[str] = "cloth"  # effects of one slot replace each other; leave out to add to the others

    # The doors follow. Keep those that you use; one is enough.

    def forces(self, balls: Balls) -> None:
        """Every step: add to balls.force [N] and balls.torque [N m], both (nsim, nball, 3)."""
        rate = np.where(balls.rolling, column(self.rate), 0.0)  # column: (nsim,) to (nsim, 1)
        balls.push_rolling(-rate[..., None] * balls.velocity[..., :2])

    def horizon(self, balls: Balls) -> Array:
        """For how long that force, or its middle, stands for all of it: (nsim, nball) [s]."""
        return np.where(balls.rolling, STEP, np.inf)

    # def impact(self, impact: Impact, rows: Any) -> None:
    #     """Before a contact: change impact.restitution and impact.friction, (n,); `of` picks the rows' parameters."""
    #     if impact.kind == "cushion":
    #         impact.restitution -= of(self.rate, rows) * (impact.approach - 1.0)

    # def strike(self, ball: Ball, velocity: Array, spin: Array) -> tuple[Array, Array]:
    #     """Once: what the struck ball really gets, (nsim, 2) [m/s] and (nsim, 3) [rad/s]."""
    #     return velocity * (1.0 - np.asarray(self.rate))[..., None], spin

    # def exposures(self, stamps: Array) -> Array:
    #     """When the camera really looked, for the stamps it reports, (n,) [s]; parameters are numbers here."""
    #     return stamps / (1.0 + self.rate)

    # def observe(self, track: Track) -> Track:
    #     """What the camera reports: positions (n, nball, 2) [m]; parameters are numbers here."""
    #     return dataclasses.replace(track, position=track.position * (1.0 + self.rate))

    # def edit(self, spec: mujoco.MjSpec) -> None:
    #     """Before compiling: change the MJCF."""
    #     spec.option.density = 1.2
'''

TEST_HEAD = '''"""{name}: what every effect owes the workbench, and its physics; pytest runs it from the checkout."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from models.contract import CONTRACTS, kept
from models.model_file import add_folder, effect_class, full_model
from models.shot import Array, Ball, Shot, Table
from models.simulate import simulate

add_folder(Path(__file__).with_name("{name}.py"))
KIND = effect_class("{name}")
BALL, TABLE = Ball(0.0525, 0.1406), Table(100.0, 100.0, pockets=False)


@pytest.mark.parametrize("contract", CONTRACTS)
def test_it_keeps_the_contract(contract: str) -> None:
    assert kept(KIND, contract) == []


def speeds(**values: float) -> Array:
    """How fast a ball is that rolls off at 1 m/s along x, with the effect at these values: (21,) [m/s], for 1 s."""
    spin = np.array([[0.0, 1.0 / BALL.radius, 0.0]])
    shot = Shot(("cue",), np.zeros((1, 2)), np.array([[1.0, 0.0]]), spin, np.linspace(0, 1, 21))
    [track] = simulate(full_model(TABLE, BALL).add(KIND(**values)), [shot])
    return np.hypot(*track.velocity[:, 0].T)

'''

TEST_TEMPLATE = (
    TEST_HEAD
    + '''
def test_its_physics() -> None:
    """Replace by what your formula says of a case that can be worked out by hand."""
    time, rolling = np.linspace(0, 1, 21), 0.0127 * 9.81  # v' = -rolling - rate v
    expected = (1 + rolling / 0.05) * np.exp(-0.05 * time) - rolling / 0.05
    np.testing.assert_allclose(speeds(rate=0.05), expected, atol=1e-4)
'''
)

TEST_SOURCE = (
    TEST_HEAD
    + '''
def test_its_physics() -> None:
    """Replace by what the formula says of a case that can be worked out by hand, such as speeds(rate=0.05)."""
    assert np.all(np.isfinite(speeds()))
'''
)


def checked_name(name: str) -> str:
    """The name, if an effect can have it; BadInput otherwise."""
    words = re.sub(r"[^a-z0-9]+", "_", re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()).strip("_0123456789")
    if not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z][a-z0-9]*)*", name):
        hint = f", such as {words}" if re.fullmatch(r"[a-z][a-z0-9]*(_[a-z][a-z0-9]*)*", words) else ""
        raise BadInput(f"{name!r} is no name for an effect; give words in small letters joined by _{hint}")
    if keyword.iskeyword(name) or keyword.issoftkeyword(name) or name in ("native", "effect", "conftest"):
        raise BadInput(f"{name!r} means something else to Python or to models; choose another name")
    if name.startswith("test_"):
        raise BadInput(f"{name!r} would be taken for a test; choose a name that does not begin with test_")
    known = catalogue()
    if name in known:
        raise BadInput(f"{name!r} is in the catalogue already (sysid effects {name}); choose another name")
    return name


def class_name(name: str) -> str:
    """The effect's class: table_tilt -> TableTilt."""
    return "".join(word.capitalize() for word in name.split("_"))


def write(name: str, folder: Path | str, source: str | None = None) -> tuple[Path, Path]:
    """Write an effect's file and its test into a folder, which is made; returns both paths.

    Args:
        name: of the effect, in snake case, not in the catalogue.
        folder: where they go; nothing there is overwritten.
        source: full text of the effect's file; the template where not given.
    """
    folder = Path(folder)
    checked_name(name)
    effect, test = folder / f"{name}.py", folder / f"test_{name}.py"
    for path in (effect, test):
        if path.exists() or path.is_symlink():
            raise BadInput(f"{path}: is there already; choose another name or folder")
    if folder.exists() and not folder.is_dir():
        raise BadInput(f"{folder}: is no folder; name one")
    title = name.replace("_", " ").capitalize()
    text = TEMPLATE.format(title=title, cls=class_name(name)) if source is None else source
    write_whole(effect, text.encode(), parents=True)
    write_whole(test, (TEST_TEMPLATE if source is None else TEST_SOURCE).format(name=name).encode())
    return effect, test


def source_of(path: Path | str, name: str) -> str:
    """The text of an effect that does what a result's unexplained structure says."""
    path = Path(path)
    try:
        result: Any = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"{path}: cannot be read ({type(error).__name__}); name a result.json") from error
    except json.JSONDecodeError as error:
        raise BadInput(f"{path}: not JSON (line {error.lineno}: {error.msg}); name a result.json") from error
    found = result.get("unexplained") if isinstance(result, dict) else None
    if not isinstance(found, dict):
        raise BadInput(f"{path}: leaves nothing unexplained; begin with the template: sysid new-effect {name}")
    return translated(found, name, path)


def translated(unexplained: dict[str, Any], name: str, path: Path) -> str:
    """The effect's text for the formula that a discovery found; BadInput where it found none."""
    try:
        if not unexplained["terms"]:
            raise ValueError
        return source_from(name, unexplained, f"sysid discover, {path.name}")
    except (KeyError, TypeError, ValueError) as error:
        raise BadInput(
            f"{path}: what is unexplained comes without a formula; begin with the template: sysid new-effect {name}"
        ) from error
