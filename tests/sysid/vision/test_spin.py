"""Turns read from the marks of filmed balls, against how these were turned."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from models.errors import BadInput
from models.shot import Table, Track
from sysid.vision.camera.projection import Array, Camera
from sysid.vision.rotation.spin import turning
from sysid.vision.rotation.spots import Spots, find_spots
from sysid.vision.rotation.turned import Turning, rate
from sysid.vision.sources.pictures import Picture
from tests.footage.cameras import overhead
from tests.footage.film import Look, Spot, film
from tests.footage.motion import Motion, motion_of

FPS = 120.0
DIAMETER = 0.0525
WHITE, BLACK = (0.95, 0.95, 0.95), (0.05, 0.05, 0.06)
PHI = (1 + 5**0.5) / 2
TWELVE = [place for a in (-1.0, 1.0) for b in (-PHI, PHI) for place in ((0, a, b), (a, b, 0), (b, 0, a))]
UNEVEN = [(0.9, 0.1, 0.5), (-0.5, 0.8, 0.4), (-0.4, -0.7, 0.6), (0.1, 0.2, -1.0), (0.6, -0.7, -0.3), (0.2, 0.3, 1.0)]


def camera_of(radius: float, size: tuple[int, int], tilt: float = 0.0) -> Camera:
    """A camera that shows a ball with this radius [pixels]."""
    return overhead(Table(2.0, 1.0), DIAMETER, size, 2.6, DIAMETER / 2 / radius * size[0], (tilt, 0.0))


def leaning(polar: float) -> tuple[float, float, float]:
    """A place this far from the top [degrees]."""
    return float(np.sin(np.radians(polar))), 0.0, float(np.cos(np.radians(polar)))


def look_of(places: Sequence[tuple[float, float, float]], width: float, colour: tuple[float, float, float]) -> Look:
    return Look(spots={"white": [Spot(p, width, colour) for p in places]})


def placed(camera: Camera, spin: float, seconds: float, brake: float = 0.0) -> tuple[Motion, Array]:
    """A ball that spins in the middle of the picture, and where it is."""
    xy = camera.on_plane(np.array([camera.size]) / 2.0, camera.radius)[0]
    times = np.linspace(0, seconds, int(seconds * 1000) + 1)
    turned = Rotation.from_rotvec(np.outer(spin * times - brake * times**2 / 2, [0, 0, 1])).as_quat()
    return Motion(("white",), times, np.tile(xy, (len(times), 1, 1)), turned[:, None]), xy


def watch(frames: Iterable[tuple[float, Picture, Array]], camera: Camera) -> Turning:
    """The rotation of a ball in pictures: (time [s], picture (h, w, 3), centre of the ball (2,) [m])."""
    seen: list[Spots] = []
    for time, picture, xy in frames:
        seen.append(find_spots(picture, time, xy, camera, seen[-1] if seen else None))
    return turning(seen, camera.radius)


def watched(camera: Camera, motion: Motion, look: Look, jitter: float = 0.1, fps: float = FPS) -> Turning:
    """What is seen of the only ball, whose places are known to `jitter` [pixels]."""
    rng = np.random.default_rng(5)
    times = np.arange(0, motion.times[-1] + 1e-9, 1 / fps)
    noise = jitter * camera.radius / camera.radius_px(motion.at(0.0)[0])[0]
    pictures = zip(times.tolist(), film(camera, motion, times, look, seed=3), strict=True)
    return watch(((time, p, motion.at(time)[0][0] + rng.normal(0, noise, 2)) for time, p in pictures), camera)


def rolling(
    radius: float, speed: float, spin: float, frames: int, roll: Callable[[Array], Array]
) -> tuple[Camera, Motion, Array]:
    """A ball with this sidespin whose spin about the horizontal is `roll` of rolling; its spin at 1 kHz."""
    seconds = (frames - 1) / FPS
    scale = DIAMETER / 2 / radius
    size = (int(0.96 * speed * seconds / scale + 3.5 * radius), int(0.3 * speed * seconds / scale + 3.5 * radius))
    camera = camera_of(radius, size)
    times = np.linspace(0, seconds, int(seconds * 1000) + 1)
    way = np.array([np.cos(0.3), np.sin(0.3)])
    middle = camera.on_plane(np.array([size]) / 2.0, camera.radius)[0]
    position = middle + np.outer(speed * (times - seconds / 2), way)
    turn = np.empty((len(times), 3))
    turn[:, :2] = np.outer(roll(times), speed / camera.radius * np.array([-way[1], way[0]]))
    turn[:, 2] = spin
    velocity = np.tile(speed * way, (len(times), 1, 1))
    track = Track(("white",), times, position[:, None], velocity, turn[:, None], np.zeros((len(times), 1)))
    return camera, motion_of(track), turn


@pytest.mark.parametrize(("radius", "spin", "polar"), [(10, 60, 40), (10, -20, 60), (20, 20, 50)])
def test_one_mark_of_a_ball_in_place_gives_its_rate(radius: float, spin: float, polar: float) -> None:
    camera = camera_of(radius, (int(3.5 * radius),) * 2)
    motion, _ = placed(camera, spin, 0.3)
    seen = watched(camera, motion, look_of([leaning(polar)], 0.35, (0.04,) * 3))
    assert np.isfinite(seen.theta).all()
    assert np.abs(seen.theta - spin * seen.time - np.mean(seen.theta - spin * seen.time)).max() < 0.04
    found = rate(seen, 0.0, 0.3)
    assert found.spin == pytest.approx(spin, rel=0.005)
    assert abs(found.spin - spin) < 6 * found.spin_sd < 0.4
    assert np.isfinite(seen.steady).all(), "in place, errors do not add up"
    assert np.isnan(seen.spin[:, :2]).all(), "a single mark shows no turn about the horizontal"
    assert any("single mark" in t and f"{np.pi * FPS:.0f} rad/s" in t for t in seen.notes)


def test_several_marks_of_a_ball_in_place() -> None:
    camera = camera_of(10, (36, 36))
    motion, _ = placed(camera, -30.0, 0.3)
    seen = watched(camera, motion, look_of(TWELVE, 0.25, (0.04,) * 3))
    assert rate(seen, 0.0, 0.3).spin == pytest.approx(-30, rel=0.002)
    np.testing.assert_allclose(np.nanmean(seen.spin, axis=0), [0, 0, -30], atol=0.5)


@pytest.mark.parametrize(("radius", "spin"), [(10, 20.0), (20, -40.0)])
def test_sidespin_and_full_spin_while_rolling(radius: float, spin: float) -> None:
    camera, motion, turn = rolling(radius, 1.0, spin, 21, np.ones_like)
    seen = watched(camera, motion, look_of(TWELVE, 0.22, (0.04,) * 3))
    assert rate(seen, 0.0, 1.0).spin == pytest.approx(spin, rel=0.03)
    error = seen.spin[1:] - turn[0]
    assert np.sqrt(np.mean(error**2)) < (2.0 if radius == 10 else 0.7)
    assert np.sqrt(np.mean((error / seen.spin_sd[1:]) ** 2)) < 2.5
    # Quaternions tell the turn since the first frame.
    first, last = (motion.at(t)[1][0] for t in (0.0, float(seen.time[-1])))
    told = Rotation.from_quat(np.roll(seen.quaternion[-1], -1))
    assert (told * Rotation.from_matrix(last @ first.T).inv()).magnitude() < 0.12
    assert any("change of spin" in t for t in seen.notes)
    assert np.isnan(seen.steady).all(), "errors that add up while it rolls are not for a fit"


def test_backspin_that_turns_into_roll_is_followed() -> None:
    camera, motion, turn = rolling(14, 1.2, -15.0, 16, lambda t: -0.5 + t / 0.1)
    seen = watched(camera, motion, look_of(UNEVEN, 0.24, (0.04,) * 3))
    middle = np.array([turn[int(1000 * (t - 0.5 / FPS))] for t in seen.time[1:]])
    error = seen.spin[1:] - middle
    assert np.isfinite(error).mean() > 0.8
    assert np.sqrt(np.nanmean(error**2)) < 3.0


@pytest.mark.slow
def test_deceleration_of_a_ball_that_spins_to_rest() -> None:
    camera = camera_of(10, (36, 36))
    motion, _ = placed(camera, 60.0, 60 / 22, 22.0)
    seen = watched(camera, motion, look_of([leaning(45)], 0.35, (0.04,) * 3))
    found = rate(seen, 0.0, 2.6)
    assert found.change == pytest.approx(-22, rel=0.005)
    assert found.spin == pytest.approx(60 - 22 * found.time, rel=0.002)


@pytest.mark.parametrize(("ball", "mark"), [(BLACK, WHITE), ((0.72, 0.05, 0.07), WHITE), ((0.93, 0.78, 0.1), BLACK)])
def test_colours_are_those_of_the_picture(ball: tuple[float, float, float], mark: tuple[float, float, float]) -> None:
    camera = camera_of(12, (42, 42))
    motion, _ = placed(camera, 40.0, 0.2)
    look = Look(spots={"white": [Spot(leaning(50), 0.3, mark)]}, colours={"white": ball})
    assert rate(watched(camera, motion, look), 0.0, 0.2).spin == pytest.approx(40, rel=0.005)


def test_a_mark_on_top_shows_no_rotation() -> None:
    camera = camera_of(14, (50, 50))
    motion, _ = placed(camera, 30.0, 0.1)
    seen = watched(camera, motion, look_of([leaning(0)], 0.35, (0.04,) * 3))
    assert np.isnan(seen.theta).all()
    assert any("shows no rotation" in t for t in seen.notes)


@pytest.mark.parametrize("colour", [BLACK, (0.94, 0.92, 0.84)])
def test_a_highlight_is_no_mark(colour: tuple[float, float, float]) -> None:
    camera = camera_of(14, (50, 50))
    motion, _ = placed(camera, 30.0, 0.1)
    seen = watched(camera, motion, Look(colours={"white": colour}))
    assert np.isnan(seen.theta).all()
    assert seen.notes == ("no mark was seen on the ball",)


def test_a_mark_out_of_sight_is_not_bridged_but_counted_on() -> None:
    camera = camera_of(14, (50, 50), tilt=0.5)
    motion, xy = placed(camera, 25.0, 0.4)
    seen = watched(camera, motion, look_of([leaning(50)], 0.3, (0.04,) * 3))
    sight = camera.eye - np.array([*xy, camera.radius])
    sight /= np.linalg.norm(sight)
    facing = np.array([motion.at(float(t))[1][0] @ np.array(leaning(50)) @ sight for t in seen.time])
    assert np.isnan(seen.theta[facing < np.cos(np.radians(70))]).all()
    assert np.isfinite(seen.theta[facing > np.cos(np.radians(60))]).all()
    assert (facing < np.cos(np.radians(70))).sum() > 5
    error = seen.theta - 25 * seen.time
    assert np.nanmax(error) - np.nanmin(error) < 0.06
    assert any("out of sight" in t for t in seen.notes)


def test_a_turn_unseen_for_long_is_not_made_up() -> None:
    camera = camera_of(12, (42, 42))
    motion, xy = placed(camera, 20.0, 0.8)
    times = np.concatenate([np.arange(0, 0.2, 1 / FPS), np.arange(0.7, 0.8, 1 / FPS)])
    pictures = film(camera, motion, times, look_of([leaning(50)], 0.35, (0.04,) * 3))
    seen = watch(((float(t), p, xy) for t, p in zip(times, pictures, strict=True)), camera)
    assert np.isfinite(seen.theta[times < 0.3]).all()
    assert np.isnan(seen.theta[times > 0.3]).all()
    np.testing.assert_allclose(seen.spin[times > 0.71, 2], 20, atol=3)
    assert any("the longest span" in t for t in seen.notes)


def test_half_a_turn_a_frame_is_the_limit_that_is_told() -> None:
    camera = camera_of(12, (42, 42))
    motion, _ = placed(camera, 2 * np.pi * 30 - 20, 0.4)
    seen = watched(camera, motion, look_of([leaning(50)], 0.35, (0.04,) * 3), fps=30.0)
    assert rate(seen, 0.0, 0.4).spin == pytest.approx(-20, rel=0.02)
    assert any(f"{np.pi * 30:.0f} rad/s" in t for t in seen.notes)


def test_the_same_pictures_give_the_same_values() -> None:
    camera, motion, _ = rolling(10, 1.0, 20.0, 6, np.ones_like)
    one, two = (watched(camera, motion, look_of(TWELVE, 0.22, (0.04,) * 3)) for _ in range(2))
    assert one.theta.tobytes() == two.theta.tobytes()
    assert one.spin.tobytes() == two.spin.tobytes()


def test_bad_input_is_named() -> None:
    camera = camera_of(12, (42, 42))
    motion, xy = placed(camera, 20.0, 0.1)
    times = np.array([0.0, 0.02, 0.01])
    pictures = list(film(camera, motion, times, look_of([leaning(50)], 0.35, (0.04,) * 3)))
    with pytest.raises(BadInput, match=r"frame 2 at 0.01 s .* sort them"):
        watch(zip(times.tolist(), pictures, [xy] * 3, strict=True), camera)
    seen = watch(zip([0.0, 0.01, 0.02], pictures, [xy, xy * np.nan, xy], strict=True), camera)
    assert np.isnan(seen.theta[1])
    with pytest.raises(BadInput, match="known in 2 frames"):
        rate(seen, 0.0, 1.0)
