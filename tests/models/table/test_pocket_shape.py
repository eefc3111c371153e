"""What files hold of pockets: true, false, a name or numbers; model files, scenes and clip sets carry all of them."""

from __future__ import annotations

import dataclasses
import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomli_w

from models.errors import BadInput
from models.model_file import full_model, read_model, write_model
from models.shot import Ball, Table
from models.table.pocket_shape import POCKET_SETS, SNOOKER_POCKETS, WPA_POCKETS, read_pockets

BALL = Ball(0.05715, 0.163)
CORNER = dataclasses.asdict(WPA_POCKETS.corner)
MIDDLE = dataclasses.asdict(WPA_POCKETS.middle)


def test_names_and_numbers_are_read() -> None:
    assert read_pockets(True) is True and read_pockets(False) is False
    assert read_pockets("pool 9 ft") == WPA_POCKETS == read_pockets({"corner": CORNER, "middle": MIDDLE})
    assert read_pockets("snooker") is True is read_pockets(dataclasses.asdict(SNOOKER_POCKETS))
    less = read_pockets({"corner": {k: v for k, v in CORNER.items() if k != "acceptance"}, "middle": MIDDLE})
    assert not isinstance(less, bool) and less.corner.acceptance == pytest.approx(0.65 * WPA_POCKETS.corner.mouth / 2)


@pytest.mark.parametrize(
    ("value", "named"),
    [
        (6, ("pockets = 6", "true or false")),
        (None, ("None", "true or false")),
        ("pool 9ft", ("'pool 9ft'", "did you mean", "pool 9 ft")),
        ("carom", ("'carom'", "true or false", "snooker")),
        ({"corner": CORNER}, ("pockets.middle", "mouth")),
        ({"corner": CORNER, "middle": 5}, ("pockets.middle", "5")),
        ({"corner": CORNER, "middle": MIDDLE, "side": MIDDLE}, ("'side'", "corner and middle")),
        ({"corner": CORNER | {"mouht": 0.1}, "middle": MIDDLE}, ("pockets.corner", "'mouht'", "did you mean mouth")),
        ({"corner": CORNER | {"mouth": 115.9}, "middle": MIDDLE}, ("pockets.corner.mouth", "115.9", "[m]")),
        ({"corner": CORNER | {"cut_angle": 142}, "middle": MIDDLE}, ("pockets.corner.cut_angle", "142", "[rad]")),
        ({"corner": CORNER | {"shelf": float("nan")}, "middle": MIDDLE}, ("pockets.corner.shelf", "nan")),
        ({"corner": CORNER | {"shelf": True}, "middle": MIDDLE}, ("pockets.corner.shelf", "True")),
    ],
)
def test_what_is_wrong_is_named(value: Any, named: tuple[str, ...]) -> None:
    with pytest.raises(BadInput) as caught:
        read_pockets(value)
    for text in named:
        assert text in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("pockets", [True, False, *POCKET_SETS.values()])
def test_a_model_file_keeps_its_pockets(pockets: Any, tmp_path: Path) -> None:
    model = full_model(Table(2.54, 1.27, pockets), BALL)
    write_model(model, tmp_path / "m.toml")
    again = read_model(tmp_path / "m.toml").table
    assert (again.shapes, bool(again.pockets)) == (model.table.shapes, bool(pockets))


def test_a_model_file_may_name_them(tmp_path: Path) -> None:
    write_model(full_model(Table(2.54, 1.27), BALL), tmp_path / "m.toml")
    data = tomllib.loads((tmp_path / "m.toml").read_text())
    assert data["table"]["pockets"] is True
    data["table"]["pockets"] = "pool 8 ft"
    (tmp_path / "m.toml").write_text(tomli_w.dumps(data))
    assert read_model(tmp_path / "m.toml").table.shapes == POCKET_SETS["pool 8 ft"]
    data["table"]["pockets"] = {"corner": CORNER}
    (tmp_path / "m.toml").write_text(tomli_w.dumps(data))
    with pytest.raises(BadInput, match=r"m\.toml \[table\]: pockets\.middle"):
        read_model(tmp_path / "m.toml")
