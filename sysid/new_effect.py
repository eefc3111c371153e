"""Files of a new effect: a template, which runs as written, and its test."""

from __future__ import annotations

import json
import keyword
import re
from pathlib import Path

from models.effect_catalogue import catalogue
from models.errors import BadInput, one_line
from models.files import read_document, write_whole
from models.files.faults import Faults
from sysid.selection.formulas.description import source_from

EFFECT_TEMPLATE = '''"""{title}: say in one line what it is.

Acceleration -rate v of a rolling ball: state the formula here, with its source, and what it leaves out.
Replace this example, which is a rolling resistance that grows with the speed, by your own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from models.effect import BallState, Effect, param, push_along


@dataclass(frozen=True)
class {cls}(Effect):
    """Deceleration in proportion to speed."""

    # Every parameter: its usual value, the value at which it vanishes, unit, bounds, and where these come from.
    rate: float = param(0.01, off=0.0, unit="1/s", bounds=(-0.1, 0.2), source="replace: where these come from")

    # slot: ClassVar[str] = "cloth"  # effects of one slot replace each other; leave out to add to the others

    # The hooks follow. Keep those that you use; one is enough. They are compiled: arithmetic on numbers, with math, of
    # the parameters in self and the state that they are given (its fields: models/hooks.py).

    def forces(self, ball: BallState) -> None:
        """Forces on a ball: add to ball.ax, ball.ay [m/s^2] and ball.bx, ball.by, ball.bz [rad/s^2]."""
        if ball.rolling:
            push_along(ball, -self.rate * math.hypot(ball.vx, ball.vy), 0.0)  # along the motion, and to the left of it

    # def horizon(self, ball: BallState) -> float:
    #     """Time until that force switches [s]; needed only for one that jumps, not for a smooth one."""
    #     return 2.0 - ball.time if ball.time < 2.0 else math.inf

    # def impact(self, hit: ImpactState) -> None:
    #     """Called before a contact: change hit.restitution, hit.friction."""
    #     if hit.cushion:
    #         hit.restitution -= self.rate * (hit.approach - 1.0)

    # def strike(self, cue: StrokeState) -> None:
    #     """Called once: change the velocity [m/s] and spin [rad/s] that the struck ball gets."""
    #     cue.vx *= 1.0 - self.rate
    #     cue.vy *= 1.0 - self.rate

    # def exposures(self, stamp: float) -> float:
    #     """True time of an exposure, for a time stamp that the camera reports [s]."""
    #     return stamp / (1.0 + self.rate)

    # def observe(self, image: ImageState) -> None:
    #     """Change the position that the camera reports of a ball: image.x, image.y [m]."""
    #     image.x *= 1.0 + self.rate
    #     image.y *= 1.0 + self.rate

    # def edit(self, spec: mujoco.MjSpec) -> None:
    #     """Change the MJCF before MuJoCo reads it; not compiled. Such an effect works in MuJoCo alone."""
    #     spec.option.density = 1.2
'''

TEST_HEAD = '''"""{name}: the contract of every effect, and its physics; pytest runs it from the checkout."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from models import Ball, Shot, Table, add_effects, catalogue, full_model, simulate
from models.contract import CONTRACTS, kept

add_effects(Path(__file__).with_name("{name}.py"))
KIND = catalogue()["{name}"]
BALL, TABLE = Ball(0.0525, 0.1406), Table(100.0, 100.0, pockets=False)


@pytest.mark.parametrize("contract", CONTRACTS)
def test_it_keeps_the_contract(contract: str) -> None:
    assert kept(KIND, contract) == []


def speeds(**values: float) -> np.ndarray:
    """Speeds of a ball that starts rolling at 1 m/s along x, with the effect at these values: (21,) [m/s], for 1 s."""
    spin = np.array([[0.0, 1.0 / BALL.radius, 0.0]])
    shot = Shot(("cue",), np.zeros((1, 2)), np.array([[1.0, 0.0]]), spin, np.linspace(0, 1, 21))
    [track] = simulate(full_model(TABLE, BALL).add(KIND(**values)), [shot])
    return np.hypot(*track.velocity[:, 0].T)

'''

TEST_TEMPLATE = (
    TEST_HEAD
    + '''
def test_its_physics() -> None:
    """Replace this by a prediction of your formula for a case that can be calculated by hand."""
    time, rolling = np.linspace(0, 1, 21), 0.0127 * 9.81  # v' = -rolling - rate v
    expected = (1 + rolling / 0.05) * np.exp(-0.05 * time) - rolling / 0.05
    np.testing.assert_allclose(speeds(rate=0.05), expected, atol=1e-4)
'''
)

TEST_OF_FORMULA = (
    TEST_HEAD
    + '''
def test_its_physics() -> None:
    """Replace this by a prediction for a case that can be calculated by hand, such as speeds(rate=0.05)."""
    assert np.all(np.isfinite(speeds()))
'''
)


def checked_name(name: str) -> str:
    """The name, if an effect can have it; BadInput otherwise."""
    words = re.sub(r"[^a-z0-9]+", "_", re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name).lower()).strip("_0123456789")
    if not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z][a-z0-9]*)*", name):
        hint = f", such as {words}" if re.fullmatch(r"[a-z][a-z0-9]*(_[a-z][a-z0-9]*)*", words) else ""
        raise BadInput(f"{name!r} is not a valid effect name; use lowercase words joined by _{hint}")
    if keyword.iskeyword(name) or keyword.issoftkeyword(name) or name in ("native", "effect", "conftest"):
        raise BadInput(f"{name!r} is reserved by Python or models; choose another name")
    if name.startswith("test_"):
        raise BadInput(f"{name!r} would be collected as a test; choose a name that does not begin with test_")
    known = catalogue()
    if name in known:
        raise BadInput(f"{name!r} is already in the catalogue (sysid effects {name}); choose another name")
    return name


def class_name(name: str) -> str:
    """The name of the effect's class: table_tilt -> TableTilt."""
    return "".join(word.capitalize() for word in name.split("_"))


def write(name: str, folder: Path | str, source: str | None = None) -> tuple[Path, Path]:
    """Write an effect's file and its test into a folder, which is created; returns both paths.

    Args:
        name: of the effect, in snake case, not in the catalogue.
        folder: for both files; nothing in it is overwritten.
        source: full text of the effect's file; by default the template.
    """
    folder = Path(folder)
    checked_name(name)
    effect, test = folder / f"{name}.py", folder / f"test_{name}.py"
    for path in (effect, test):
        if path.exists() or path.is_symlink():
            raise BadInput(f"{path}: already exists; choose another name or folder")
    if folder.exists() and not folder.is_dir():
        raise BadInput(f"{folder}: is not a folder; name one")
    title = name.replace("_", " ").capitalize()
    text = EFFECT_TEMPLATE.format(title=title, cls=class_name(name)) if source is None else source
    write_whole(effect, text.encode(), parents=True)
    try:
        write_whole(test, (TEST_TEMPLATE if source is None else TEST_OF_FORMULA).format(name=name).encode())
    except BaseException:  # both or none, so that the same command works once there is room
        effect.unlink(missing_ok=True)
        raise
    return effect, test


def source_of(path: Path | str, name: str) -> str:
    """The text of an effect with the formula of a result's unexplained structure."""
    path, faults = Path(path), Faults()
    where = one_line(str(path))
    result = faults.settle(read_document(path, where, faults, "name a result.json", json.loads))
    found = result.get("unexplained") if isinstance(result, dict) else None
    if not isinstance(found, dict):
        raise BadInput(f"{where}: leaves nothing unexplained; start from the template: sysid new-effect {name}")
    if not found.get("terms"):
        raise BadInput(
            f"{where}: the unexplained structure has no formula; start from the template: sysid new-effect {name}"
        )
    try:
        return source_from(name, found, f"sysid discover, {path.name}")
    except BadInput as error:
        raise BadInput(f"{where}: {error}") from error
