"""Sizes of table and ball that a fit corrected: both engines play them, and model files keep them."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from models.engine.play import finish
from models.errors import BadInput
from models.model_file import Estimate, full_model, read_model, write_model
from models.shot import Array, Ball, Shot, Table
from models.simulation.simulate import simulate
from models.table.sizes import BALL_DIAMETER, SIZE_NAMES, TABLE_LENGTH, TABLE_WIDTH

TABLE, BALL = Table(3.569, 1.778), Ball(0.0525, 0.1406)
MODEL = full_model(TABLE, BALL)
SIZES = {TABLE_LENGTH: 3.5583, TABLE_WIDTH: 1.7833, BALL_DIAMETER: 0.0527}
MEASURED = full_model(Table(3.5583, 1.7833), Ball(0.0527, 0.1406))


def shot() -> Shot:
    """Through another ball, and off two cushions."""
    place, velocity = np.array([[-0.5, 0.1], [0.3, 0.12]]), np.array([[3.0, 0.02], [0.0, 0.0]])
    spin = np.array([[0.0, 20.0, 30.0], [0.0, 0.0, 0.0]])
    return Shot(("white", "red"), place, velocity, spin, np.linspace(0.0, 2.5, 26))


def path(engine: str, model: object = MODEL, **sizes: object) -> Array:
    """Where the balls of one shot, or of one for each of its sizes, are: (n, times, balls, 2)."""
    own = dataclasses.replace(model, engine=engine)  # type: ignore[type-var]
    own = own.with_values({name.replace("__", "."): value for name, value in sizes.items()})  # type: ignore[attr-defined]
    count = max((np.size(value) for value in sizes.values()), default=1)
    return np.array([track.position for track in simulate(own, [shot()] * count)])


@pytest.mark.parametrize("engine", ["events", "mujoco"])
def test_a_fitted_size_is_played_as_a_table_of_that_size(engine: str) -> None:
    own = {name.replace(".", "__"): value for name, value in SIZES.items()}
    assert path(engine, **own).tobytes() == path(engine, MEASURED).tobytes()
    assert path(engine, **own).tobytes() != path(engine).tobytes()


@pytest.mark.parametrize("engine", ["events", "mujoco"])
@pytest.mark.parametrize("name", SIZE_NAMES)
def test_each_shot_may_have_its_own_size(engine: str, name: str) -> None:
    key, sizes = name.replace(".", "__"), np.array([0.997, 1.0, 1.004]) * MODEL.meta(name)["default"]
    many = path(engine, **{key: sizes})
    for row, size in zip(many, sizes, strict=True):
        assert np.array_equal(row, path(engine, **{key: float(size)})[0])
    assert not np.array_equal(many[0], many[2])


def test_jaws_stand_where_the_fitted_cushions_do() -> None:
    p, v, w = np.array([[[1.2, 0.3]]]), np.array([[[2.0, 2.0]]]), np.zeros((1, 1, 3))
    one, two = (finish(model, p, v, w, jaws=True) for model in (MODEL.with_values(SIZES), MEASURED))
    assert one.position.tobytes() == two.position.tobytes()
    with pytest.raises(ValueError, match=r"table\.length has one value per simulation"):
        finish(MODEL.with_values({TABLE_LENGTH: np.array([3.5])}), p, v, w, jaws=True)


def test_a_model_file_keeps_stated_and_fitted_sizes(tmp_path: Path) -> None:
    estimates = {name: Estimate(1e-4, "a fit") for name in SIZE_NAMES}
    model = dataclasses.replace(MODEL.with_values(SIZES), estimates=estimates)
    write_model(model, tmp_path / "m.toml")
    back = read_model(tmp_path / "m.toml")
    assert (back.table, back.ball, dict(back.sizes)) == (TABLE, BALL, SIZES)
    assert {name: back.estimates[name] for name in SIZE_NAMES} == estimates
    played = back.as_played()
    assert (played.table, played.ball, played.sizes) == (MEASURED.table, MEASURED.ball, {})
    assert MODEL.parameters().keys().isdisjoint(SIZE_NAMES) and set(SIZE_NAMES) < back.parameters().keys()


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ('"table.length" = 4.0', "table.length"),
        ('"table.height" = 0.8', "table.height"),
        ('"ball.diameter" = "x"', "x"),
    ],
)
def test_a_bad_size_of_a_model_file_is_named(tmp_path: Path, entry: str, words: str) -> None:
    write_model(MODEL, tmp_path / "m.toml")
    text = (tmp_path / "m.toml").read_text(encoding="utf-8")
    (tmp_path / "m.toml").write_text(f"{text}\n[size]\n{entry}\n", encoding="utf-8")
    with pytest.raises(BadInput, match=words) as error:
        read_model(tmp_path / "m.toml")
    assert "\n" not in str(error.value)
