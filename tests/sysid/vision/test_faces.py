"""Balls of pool, plain and striped, as a webcam shows them: found and followed whatever they show, and named."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from models.errors import BadInput
from models.shot import Array, Table
from sysid.vision.balls.colours.faces import are_patterned, face
from sysid.vision.balls.colours.names import MIN_SURE_PROBABILITY, name_faces, names_by_faces
from sysid.vision.balls.colours.palette import default_palette, palette_for, pool_palette, read_palette
from sysid.vision.balls.cover import not_table
from sysid.vision.balls.detect import Detector
from sysid.vision.balls.discs import new_discs
from sysid.vision.balls.learning import learn_detector
from sysid.vision.sources.pictures import Picture
from sysid.vision.tracks.track import track
from tests.footage.cameras import overhead
from tests.footage.film import Look, Spot, film
from tests.footage.motion import Motion
from tests.footage.webcam import Webcam, webcam
from tests.support.drawn_balls import footage_of, shown

TABLE, DIAMETER = Table(1.2, 0.65), 0.05715
CAMERA = overhead(TABLE, DIAMETER, (640, 380), 1.5, 1.36, (0.02, -0.02))
FPS, SECONDS = 30.0, 1.0
NAMES = ("white", "yellow_stripe", "yellow", "red_stripe", "blue", "black")
PLACES = np.array([[-0.45, -0.2], [0.3, 0.2], [0.1, -0.2], [-0.2, 0.22], [0.45, -0.1], [-0.1, 0.0]])
VELOCITIES = np.array([[0.75, 0.2], [-0.5, -0.05], [0, 0], [0, 0], [0, 0], [0, 0]])
WHITE = (0.94, 0.92, 0.84)
POLE, CIRCLE = 0.98, 0.45  # half angles of the white poles of stripes and of circles with a number [rad]

Filmed = tuple[Motion, list[Picture], Path, Detector]


def look() -> Look:
    """What balls of pool look like: poles on striped ones, two circles on plain ones."""
    palette = pool_palette()
    colour = dict(zip(palette.names, [tuple(c.tolist()) for c in palette.colours], strict=True))
    wide = {name: 0.0 if name == "white" else POLE if name.endswith("stripe") else CIRCLE for name in NAMES}
    spots = {name: [Spot((0, 0, z), wide[name], WHITE) for z in (1, -1)] for name in NAMES if wide[name]}
    return Look(
        exposure=0.01, noise=2.0, parts=3, shadow=0.45, light=(0.05, 0.03, 1.0), spots=spots,
        colours={name: colour[name] for name in NAMES},
    )  # fmt: skip


def rolling() -> Motion:
    """Two balls roll, turning as they do; the others rest as they happen to lie."""
    times = np.arange(0, SECONDS + 0.3, 1e-3)
    way = np.clip(times - 0.3, 0, None)
    start = Rotation.random(len(NAMES), rng=np.random.default_rng(5))
    turned = np.empty((len(times), len(NAMES), 4))
    for k, v in enumerate(VELOCITIES):
        turn = Rotation.from_rotvec(way[:, None] * np.array([-v[1], v[0], 0.0]) / CAMERA.radius)
        turned[:, k] = (turn * start[k]).as_quat()
    return Motion(NAMES, times, PLACES + VELOCITIES * way[:, None, None], turned)


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Filmed:
    motion = rolling()
    pictures = film(CAMERA, motion, np.arange(0, SECONDS, 1 / FPS), look())
    how = Webcam(quality=50, hand=(-0.55, 0.25), seed=1)
    shown, folder = list(webcam(pictures, how)), tmp_path_factory.mktemp("pool")
    return motion, shown, folder, learn_detector(CAMERA, footage_of(folder, shown), pool_palette())


def true_place(motion: Motion, time: float, ball: int) -> Array:
    return np.array([np.interp(time, motion.times, motion.position[:, ball, axis]) for axis in (0, 1)])


def test_shadows_are_table_and_what_has_another_colour_or_none_is_not() -> None:
    table = np.full((1, 4, 3), (180.0, 140.0, 50.0), np.float32)
    window = table * np.array([1.0, 0.75, 0.2, 1.0], np.float32)[None, :, None]
    window[0, 3] = (60, 60, 200)
    assert not_table(window, table)[0] == pytest.approx([0, 0, 1, 1], abs=0.01)


def test_balls_of_pool_are_usual_where_balls_have_their_size_and_tables_pockets() -> None:
    assert palette_for(None, Table(2.54, 1.27), 0.05715).names == pool_palette().names
    assert palette_for(None, Table(3.569, 1.778), 0.0525).names == default_palette().names
    assert palette_for(None, Table(2.84, 1.42, pockets=False), 0.05715).names == default_palette().names


def test_a_palette_tells_how_white_its_balls_are(tmp_path: Path) -> None:
    path = tmp_path / "balls.toml"
    path.write_text(
        '[[ball]]\nname = "nine"\nrgb = [0.9, 0.7, 0.1]\nwhite = 0.45\n[[ball]]\nname = "cue"\nrgb = [1, 1, 1]\n'
    )
    assert read_palette(path).white == (0.45, 0.0)
    assert read_palette(path).patterned
    assert not default_palette().patterned
    path.write_text('[[ball]]\nname = "nine"\nrgb = [0.9, 0.7, 0.1]\nwhite = 1.5\n')
    with pytest.raises(BadInput, match="white"):
        read_palette(path)


@pytest.mark.parametrize("light", [(1.0, 1.0, 1.0), (0.8, 0.7, 0.6)])
def test_faces_are_named_by_their_colours_and_by_how_white_they_are(light: tuple[float, float, float]) -> None:
    """A plain and a striped ball of every colour, half hidden stripes among them."""
    rng, palette = np.random.default_rng(3), pool_palette()
    faces = []
    for name, colour, share in zip(palette.names, palette.colours, palette.white, strict=True):
        white = rng.random(200) < share * (1.4 if name.startswith("red") else 0.8)
        shown = np.where(white[:, None], palette.colours[0], colour) * rng.normal(1, 0.1, (200, 1))
        faces.append(np.clip(shown * light + rng.normal(0, 0.02, (200, 3)), 0, 1))
    assert name_faces([[one] for one in faces], palette).names == palette.names


def seen_lying(name: str, axis: Sequence[float], cloth: Array, veil: float) -> Array:
    """The face of a ball of pool that lies with its poles along an axis, in the light that a cloth throws on it."""
    palette = pool_palette()
    kind = next(one for one in (palette, *palette.variants) if name in one.names)
    k, along = kind.names.index(name), np.array(axis) / np.linalg.norm(axis)
    x, y = np.meshgrid(*[np.linspace(-0.9, 0.9, 41)] * 2)
    inside = x**2 + y**2 < 0.9**2
    normals = np.column_stack([x[inside], y[inside], np.sqrt(1 - x[inside] ** 2 - y[inside] ** 2)])
    white = np.abs(normals @ along) > 1 - kind.white[k]
    shown = np.where(white[:, None], kind.colours[0], kind.colours[k]) + veil * cloth
    noise = np.random.default_rng(k).normal(0, 0.02, shown.shape)
    return np.clip(shown + noise, 0, 1)


def test_balls_are_named_in_the_light_that_a_cloth_throws_on_them() -> None:
    """A quarter of a blue cloth's colour: black looks dark blue then, and maroon purple. Of television, 4 is pink."""
    cloth = np.array([0.0, 0.52, 0.87])
    names = ("white", "yellow", "blue", "red", "pink", "green", "maroon", "black", "yellow_stripe")
    faces = [[seen_lying(name, (0.9, 0.3, 0.3), cloth, 0.25)] for name in names]
    naming = name_faces(faces, pool_palette(), cloth)
    assert naming.names == names
    assert min(naming.odds) > 0.85


def test_a_cue_ball_with_dots_is_known_from_stripes_that_lie_on_their_colour() -> None:
    """Of these all but the rim is white. Which is which is not sure then, and is said."""
    dotted = seen_lying("white", (0, 0, 1), np.zeros(3), 0.0)
    dotted[::25] = (0.85, 0.2, 0.2)
    names = ("orange_stripe", "blue_stripe")
    faces = [[dotted], *[[seen_lying(name, (0.05, 0.1, 1), np.zeros(3), 0.0)] for name in names]]
    naming = name_faces(faces, pool_palette())
    assert naming.names[0] == "white"
    assert all(str(name).endswith("_stripe") for name in naming.names[1:])
    alone = name_faces([[np.tile(pool_palette().colours[0] * 0.97, (300, 1))]] * 2, pool_palette())
    assert min(alone.odds) < MIN_SURE_PROBABILITY
    assert any("white" in doubt for doubt in alone.doubts)


def test_a_lone_white_ball_with_dark_marks_is_white(tmp_path: Path) -> None:
    """A dark ball in a bright light would vary as much; but then the picture would be the brighter one."""
    ways = ((0, 0, 1), (1, 0, 0), (0, 1, 0.2), (-1, 0.3, 0.4), (0, -1, 0.5), (0.1, 0.2, -1))
    marks = [Spot(way, 0.45) for way in ways]
    look = Look(noise=4.0, light=(1.2, 0.5, 1.0), spots={"white": marks}, colours={"white": WHITE})
    places = np.random.default_rng(2).uniform(-1, 1, (8, 1, 2)) * [0.5, 0.25]
    pictures = shown(CAMERA, ("white",), places, look)
    detector = learn_detector(CAMERA, footage_of(tmp_path / "lone", pictures), pool_palette())
    assert detector.palette is not None, "it is taken to have several colours"
    views = [detector.background.view(picture) for picture in pictures]
    faces = [
        face(detector.background, view, one.xy, one.radius) for view in views for one in detector.find(view.picture)
    ]
    found, naming = names_by_faces({"ball": faces}, pool_palette(), detector.background.bed_colour)
    assert len(faces) == len(pictures) and found == {"ball": "white"}
    assert naming.odds[0] > MIN_SURE_PROBABILITY and not naming.doubts


def test_light_is_not_known_by_a_channel_that_the_cloth_hardly_reflects(tmp_path: Path) -> None:
    """On a deep blue cloth its red, which mixes in from other channels, made a white ball pink."""
    names = ("white", "red", "orange", "yellow_stripe", "maroon", "black")
    palette = pool_palette()
    colour = dict(zip(palette.names, [tuple(c.tolist()) for c in palette.colours], strict=True))
    spots = {name: [Spot((0, 0, z), CIRCLE, WHITE) for z in (1, -1)] for name in names[1:]}
    spots["yellow_stripe"] = [Spot((0, 0, z), POLE, WHITE) for z in (1, -1)]
    drawn = Look(noise=2.0, spots=spots, colours={n: colour[n] for n in names}, cloth=(0.0, 0.25, 0.6))
    pictures = shown(CAMERA, names, PLACES + np.linspace(0, 0.04, 6)[:, None, None] * [1, 0], drawn)
    mixed = np.linspace(16, 0, CAMERA.size[0])[None, :]
    pictures = [np.dstack([p[..., :2], np.maximum(p[..., 2], mixed).astype(np.uint8)]) for p in pictures]
    detector = learn_detector(CAMERA, footage_of(tmp_path / "blue", pictures), pool_palette())
    light = detector.background.light[detector.background.probes]
    assert np.ptp(light[:, 2]) < 1.5 * np.ptp(light[:, 1])
    view = detector.background.view(pictures[0])
    pixels = CAMERA.outline(PLACES)
    faces = {n: [face(detector.background, view, at, 14.0)] for n, at in zip(names, pixels, strict=True)}
    found, _ = names_by_faces(faces, pool_palette(), detector.background.bed_colour)
    assert found == {name: name for name in names}


def test_balls_of_one_colour_are_known_from_others() -> None:
    rng = np.random.default_rng(1)
    plain = [np.clip(rng.normal(c, 0.03, (200, 3)), 0, 1) for c in ((0.9, 0.9, 0.8), (0.7, 0.1, 0.1))]
    for one in plain:
        one[:15] = 1.0  # a highlight
    striped = plain[1].copy()
    striped[:60] = plain[0][:60]
    assert not are_patterned([])
    assert not are_patterned(plain)
    assert are_patterned([*plain, striped])


@pytest.mark.slow
def test_balls_of_any_face_are_found_and_hands_are_not(filmed: Filmed) -> None:
    _, pictures, _, detector = filmed
    view = detector.background.view(pictures[3])
    found = sorted(fit.xy.tolist() for fit in new_discs(view, None))
    expected = sorted(CAMERA.project(np.column_stack([PLACES, np.full(len(NAMES), CAMERA.radius)])).tolist())
    assert np.array(found) == pytest.approx(np.array(expected), abs=1.5)


@pytest.mark.slow
def test_pool_balls_are_followed_and_named(filmed: Filmed) -> None:
    """The two that roll show other faces in every frame; noise at rest is what compression leaves."""
    motion, pictures, folder, detector = filmed
    footage, palette = footage_of(folder, pictures), pool_palette()
    found = track(footage, CAMERA, detector, dict(zip(palette.names, palette.counts, strict=True)))
    assert {path.name for path in found.scene.tracks} == set(NAMES)
    scale = 100.0 / FPS  # the folder's pictures are read as if taken at 100 frames a second
    for path in found.scene.tracks:
        ball = NAMES.index(path.name)
        error = path.xy - [true_place(motion, t * scale, ball) for t in path.time]
        assert len(path.time) > 0.9 * len(pictures), path.name
        assert np.abs(np.median(error, axis=0)).max() < 2e-3, path.name
        assert np.median(np.abs(error - np.median(error, axis=0))) < 0.8e-3, path.name
