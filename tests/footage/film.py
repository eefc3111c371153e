"""Test footage: pictures of a table as a camera would see them, drawn ray by ray where it matters.

Balls are spheres with a pattern, seen through the calibrated camera with all its distortion; the table is a plane
picture. On top come what cameras do: blur during the exposure, rows read one after another, uneven light, shadows,
noise. The truth is known to far below a pixel. Needs no OpenGL.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from models.shot import NOSE_HEIGHT
from sysid.vision.camera.projection import Array, Camera, meet_plane
from tests.footage.cards import Card, lay
from tests.footage.motion import Cue, Motion

Picture = NDArray[np.uint8]
Light = NDArray[np.float32]
Colour = tuple[float, float, float]  # red, green, blue, 0 to 1
Patch = tuple[tuple[int, int, int, int], Array, Array]  # columns and rows; the share of the light left; light added
Still = dict[tuple[int, bytes, bytes], tuple[Patch | None, Patch | None]]  # shadow and ball by number, place and axes

BALLS: Mapping[str, Colour] = {
    "white": (0.94, 0.92, 0.84), "cue": (0.94, 0.92, 0.84), "red": (0.72, 0.05, 0.07), "yellow": (0.93, 0.78, 0.10),
    "green": (0.02, 0.38, 0.18), "brown": (0.42, 0.22, 0.10), "blue": (0.08, 0.20, 0.66), "pink": (0.93, 0.52, 0.62),
    "black": (0.05, 0.05, 0.06),
}  # fmt: skip
CLOTH: Colour = (0.05, 0.42, 0.20)
CUSHION: Colour = (0.03, 0.30, 0.14)
WOOD: Colour = (0.30, 0.15, 0.08)
FLOOR: Colour = (0.16, 0.15, 0.15)
HOLE: Colour = (0.01, 0.01, 0.01)
CUE_WOOD: Colour = (0.95, 0.80, 0.55)
LEATHER: Colour = (0.25, 0.35, 0.60)
MARK: Colour = (0.04, 0.04, 0.04)
RUBBER = 0.05  # width of the cushions [m]
FRAME = 0.10  # and of the wood behind them [m]
RAIL_RISE = 0.006  # of the wood over the noses [m]
DIAMOND_ROW = 0.09  # of diamonds behind the noses [m]
DIAMOND: Colour = (0.92, 0.90, 0.84)
SHADE = (0.55, 0.80)  # of light that is left in a cushion's shadows: the dark one, and one twice as wide
TOP_LIGHT = np.array([0.85, 0.45, 1.1, 1.2])  # on the cloth of the cushions' tops, by rail
LAMP_COLOURS = np.array([[0.85, 1.05, 1.15], [1.05, 0.95, 0.75]])  # of the light at the left end and at the right
SLEEVE: Colour = (0.25, 0.10, 0.14)
SKIN: Colour = (0.85, 0.60, 0.52)
FINE = 4  # rays along the side of a pixel
SHIFT = 8  # bits of sub-pixel positions in OpenCV's drawing
CUE_FINE = 8  # finer pixels along the side of one, for the cue


@dataclass(frozen=True)
class Spot:
    """A round mark on a ball."""

    place: tuple[float, float, float]  # its middle, in the ball's axes; any length
    angle: float  # half its width, seen from the ball's centre [rad]
    colour: Colour = MARK


@dataclass(frozen=True)
class Look:
    """What light and camera make of the scene; from `cushion_shadow` on, in pictures drawn without OpenGL."""

    exposure: float = 0.0  # during which a picture is taken [s]
    readout: float = 0.0  # from the first row to the last [s]
    noise: float = 5.0  # one standard deviation [grey levels]
    blur: float = 0.6  # of the lens, one standard deviation [pixels]
    uneven: float = 0.15  # of the light across the picture, 0 to 1
    shadow: float = 0.3  # of the balls on the cloth, 0 to 1
    light: tuple[float, float, float] = (0.35, 0.2, 1.0)  # where it comes from; any length
    gloss: float = 0.35  # of the balls, 0 to 1
    parts: int = 5  # moments of an exposure that are drawn
    spots: Mapping[str, Sequence[Spot]] = field(default_factory=dict)  # of balls by name
    colours: Mapping[str, Colour] = field(default_factory=dict)  # of balls by name, in place of the usual ones
    cushion_shadow: float = 0.0  # width of the shadow that the cushions cast on the bed [m]
    cloth: Colour = CLOTH
    cloth_tops: bool = False  # the cushions' tops have the colour of the bed, lit as they lean
    diamonds: float = 0.0  # diameter of those on the rails [m]; none if 0
    lamps: float = 0.0  # how much the colour of the light changes across the table, 0 to 1
    player: bool = False  # an arm with a cue lies over the table
    cards: Sequence[Card] = ()  # printed markers on the cushions


def film(
    camera: Camera, motion: Motion, times: Array, look: Look = Look(), seed: int = 0, opengl: bool = False
) -> Iterator[Picture]:
    """Pictures (height, width, 3), blue, green, red, taken at times (k,) [s]: the middle row's middle of exposure.

    `opengl`: drawn by MuJoCo; BadInput where it cannot.
    """
    rng = np.random.default_rng(seed)
    if opengl:
        from tests.footage.film_gl import Drawn

        with Drawn(camera, motion, look) as drawn:
            for time in times:
                yield developed(exposed(drawn.picture, float(time), look), look, rng)
        return
    ground, still = table_picture(camera, look), Still()
    for time in times:
        light = exposed(lambda at: _picture(camera, motion, at, look, ground, still), float(time), look)
        yield developed(light, look, rng)


def exposed(picture: Callable[[float], Light], time: float, look: Look) -> Light:
    """The light that falls on the sensor during an exposure: (height, width, 3), red, green, blue, 0 to 1."""
    parts = look.parts if look.exposure > 0 else 1
    moments = time + look.exposure * ((np.arange(parts) + 0.5) / parts - 0.5)
    return np.asarray(sum(picture(float(at)) for at in moments) / np.float32(parts), np.float32)


def developed(picture: Light, look: Look, rng: np.random.Generator) -> Picture:
    """What the sensor makes of the light (height, width, 3), 0 to 1 in red, green, blue: blur and noise."""
    if look.blur > 0:
        picture = cv2.GaussianBlur(picture, (0, 0), look.blur)
    grey = 255.0 * picture[..., ::-1]
    if look.noise > 0:
        grey = grey + look.noise * rng.standard_normal(grey.shape, dtype=np.float32)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def _unit(vector: Sequence[float] | Array) -> Array:
    v = np.asarray(vector, float)
    return np.asarray(v / np.linalg.norm(v))


def brightness(camera: Camera, look: Look, pixels: Array) -> Array:
    """Brightness of the light at pixels (n, 2): (n,)."""
    w, h = camera.size
    u, v = 2 * pixels[:, 0] / w - 1, 2 * pixels[:, 1] / h - 1
    return np.asarray(1.0 - look.uneven * (0.25 * (u**2 + v**2) + 0.25 * u + 0.15 * v))


def table_picture(camera: Camera, look: Look) -> Light:
    """The empty table: (height, width, 3), red, green, blue, 0 to 1."""
    w, h = camera.size
    grid = np.stack(np.meshgrid(np.arange(w), np.arange(h)), axis=-1).reshape(-1, 2).astype(float)
    offsets = (np.arange(2) + 0.5) / 2 - 0.5
    total = np.zeros((h * w, 3))
    for dx in offsets:
        for dy in offsets:
            total += _lit(camera, look, grid + np.array([dx, dy]))
    light = brightness(camera, look, grid)[:, None] * _lamplight(camera, look, grid)
    picture = np.asarray((total / offsets.size**2 * light).reshape(h, w, 3), np.float32)
    if look.player:
        _player(camera, look, picture)
    return picture


def _lit(camera: Camera, look: Look, pixels: Array) -> Array:
    """Colour of the empty table with its diamonds, cloth tops and cushion shadows at pixels (n, 2): (n, 3)."""
    rays, nose = camera.rays(pixels), NOSE_HEIGHT * camera.radius
    out = _ground(camera, rays)
    half = np.array([camera.table.length, camera.table.width]) / 2

    def seen_at(height: float) -> Array:
        return np.nan_to_num(meet_plane(camera.eye, rays, height), nan=9.0)

    top = seen_at(nose)
    beyond = np.maximum(*(np.abs(top) - half).T)
    hole = np.logical_and.reduce([out[:, k] == HOLE[k] for k in range(3)])
    out[(beyond < 0) & ~hole] *= np.array(look.cloth) / CLOTH
    if look.cloth_tops:
        over = np.abs(top) - half
        rail_seen = np.where(over[:, 0] > over[:, 1], (top[:, 0] < 0).astype(int), 2 + (top[:, 1] < 0))
        tops = (beyond > 0) & (beyond < RUBBER) & ~hole
        out[tops] = TOP_LIGHT[rail_seen[tops], None] * np.array(look.cloth)
    if look.cushion_shadow > 0:
        inside = np.minimum(*(half - np.abs(seen_at(0.0))).T)
        for width, left in zip((look.cushion_shadow, 2 * look.cushion_shadow), SHADE, strict=True):
            out[(beyond < 0) & (inside < width) & ~hole] *= left
    if look.diamonds > 0:
        rail = seen_at(nose + RAIL_RISE)
        for axis, parts in ((0, 8), (1, 4)):
            step = 2 * half[axis] / parts
            near = np.rint(rail[:, axis] / step)
            counts = (np.abs(near) < parts / 2) & ((axis == 1) | ~np.bool_(camera.table.pockets) | (near != 0))
            away = np.hypot(
                rail[:, axis] - near * step, np.abs(rail[:, 1 - axis]) - half[1 - axis] - DIAMOND_ROW
            )  # fmt: skip
            out[counts & (away < look.diamonds / 2)] = DIAMOND
    lay(look.cards, camera, rays, out, RAIL_RISE)
    return out


def _lamplight(camera: Camera, look: Look, pixels: Array) -> Array:
    """Colour of the light at pixels (n, 2): (n, 3)."""
    part = look.lamps * pixels[:, :1] / camera.size[0]
    return np.asarray((1 - look.lamps) + (look.lamps - part) * LAMP_COLOURS[0] + part * LAMP_COLOURS[1])


def _player(camera: Camera, look: Look, picture: Light) -> None:
    """An arm that reaches over a long cushion, with a cue in its hand."""
    high, half = 0.12, camera.table.width / 2
    for colour, outline in (
        (SLEEVE, [(-0.12, half + 0.4), (0.02, half + 0.4), (0.0, 0.25 * half), (-0.06, 0.25 * half)]),
        (SKIN, [(0.0, 0.26 * half), (0.01, 0.1 * half), (-0.07, 0.1 * half), (-0.06, 0.26 * half)]),
    ):
        points = camera.project(np.array([[x, y, high] for x, y in outline]))
        cv2.fillPoly(picture, [np.rint(points).astype(np.int32)], colour, cv2.LINE_AA)
    _cue(camera, Cue(1.0, (-0.03, -0.1 * half, 0.05), -np.pi / 2, 1.0, elevation=0.05), 0.9, look, picture)


def _ground(camera: Camera, rays: Array) -> Array:
    """Colour of the empty table where rays (n, 3) meet it: (n, 3)."""
    table, nose = camera.table, NOSE_HEIGHT * camera.radius
    half = np.array([table.length / 2, table.width / 2])
    cloth, top = (meet_plane(camera.eye, rays, z) for z in (0.0, nose))
    out = np.tile(np.array(CLOTH), (len(rays), 1))
    weave = 0.02 * np.sin(cloth[:, 0] * 900) * np.sin(cloth[:, 1] * 900)
    out *= (1 + np.nan_to_num(weave))[:, None]
    top = np.nan_to_num(top, nan=1e3)
    beyond = np.maximum(*(np.abs(top) - half).T)
    out[beyond > 0] = CUSHION
    out[beyond > RUBBER] = WOOD
    out[beyond > RUBBER + FRAME] = FLOOR
    if table.pockets:
        back = table.shapes.corner.mouth / 2
        for sx in (-1, 0, 1):
            for sy in (-1, 1):
                middle = np.array([sx * half[0], sy * half[1]]) + (0.3 if sx else 1.0) * back * np.array([sx, sy])
                dx, dy = (top - middle).T
                out[np.sqrt(dx**2 + dy**2) < back] = HOLE
    return out


def _picture(
    camera: Camera, motion: Motion, moment: float, look: Look, ground: Light, still: Still | None = None
) -> Light:
    """The light at a moment; of balls that lie where they lay before, what `still` holds is drawn again."""
    picture, still = ground.copy(), {} if still is None else still
    balls = []
    for k in range(len(motion.names)):
        place, velocity, axes, when = when_read(camera, motion, k, moment, look)
        if not np.isfinite(place).all():
            continue
        key = (k, place.tobytes(), axes.tobytes())
        patches = still.get(key) if not velocity.any() else None
        if patches is None:
            patches = (
                _shadow(camera, place, look),
                _ball(camera, motion.names[k], moment, (place, velocity, axes, when), look),
            )
            if not velocity.any():
                still[key] = patches
        balls.append(patches)
    for shadow, _ in balls:
        if shadow is not None:
            (x0, x1, y0, y1), left, _ = shadow
            picture[y0:y1, x0:x1] *= left
    for _, ball in balls:
        if ball is not None:
            (x0, x1, y0, y1), left, seen = ball
            picture[y0:y1, x0:x1] = picture[y0:y1, x0:x1] * left + seen
    if motion.cue is not None:
        _cue(camera, motion.cue, moment, look, picture)
    return picture


def _delay(camera: Camera, look: Look, row: Array | float) -> Array:
    """When a row is read, after the middle one [s]."""
    return np.asarray(look.readout * (np.asarray(row, float) / (camera.size[1] - 1) - 0.5))


def _patch(camera: Camera, pixels: Array, margin: float) -> tuple[int, int, int, int] | None:
    """Columns and rows (x0, x1, y0, y1) of a picture that hold these pixels; None outside."""
    low, high = np.floor(pixels.min(axis=0) - margin).astype(int), np.ceil(pixels.max(axis=0) + margin).astype(int)
    x0, y0 = max(low[0], 0), max(low[1], 0)
    x1, y1 = min(high[0] + 1, camera.size[0]), min(high[1] + 1, camera.size[1])
    return (x0, x1, y0, y1) if x1 > x0 and y1 > y0 else None


def when_read(camera: Camera, motion: Motion, k: int, moment: float, look: Look) -> tuple[Array, Array, Array, float]:
    """Place (2,), velocity (2,), orientation (3, 3) of a ball as its own rows are read, and when that is."""
    when = moment
    for _ in range(3 if look.readout else 1):
        place = motion.at(when)[0][k]
        if look.readout and np.isfinite(place).all():
            when = moment + float(_delay(camera, look, camera.outline(place[None])[0, 1]))
    (place, axes), (later, _) = (tuple(v[k] for v in motion.at(t)) for t in (when, when + 1e-4))
    return place, (later - place) / 1e-4, axes, when


def _shadow(camera: Camera, place: Array, look: Look) -> Patch | None:
    """What a ball's shadow leaves of the light where it falls."""
    if look.shadow <= 0:
        return None
    light, r = _unit(look.light), camera.radius
    middle = place - light[:2] / light[2] * r
    ring = middle + 1.3 * r * np.array([[np.cos(a), np.sin(a)] for a in np.linspace(0, 2 * np.pi, 12)])
    box = _patch(camera, camera.project(np.column_stack([ring, np.zeros(len(ring))])), 2)
    if box is None:
        return None
    x0, x1, y0, y1 = box
    grid = np.stack(np.meshgrid(np.arange(x0, x1), np.arange(y0, y1)), axis=-1).reshape(-1, 2).astype(float)
    far = np.linalg.norm(camera.on_plane(grid, 0.0) - middle, axis=1) / r
    dark = look.shadow * np.clip((1.3 - far) / 0.5, 0, 1)
    return box, (1 - dark).reshape(y1 - y0, x1 - x0, 1).astype(np.float32), np.zeros(1)


def _ball(
    camera: Camera, name: str, moment: float, read: tuple[Array, Array, Array, float], look: Look
) -> Patch | None:  # fmt: skip
    """What a ball leaves of the light where it is seen, and its own; `read` as `when_read` gives it."""
    place, velocity, axes, when = read
    box = _patch(camera, camera.rims(place[None])[0], 2)
    if box is None:
        return None
    x0, x1, y0, y1 = box
    sub = (np.arange(FINE) + 0.5) / FINE - 0.5
    xs, ys = (np.arange(a, b)[:, None] + sub for a, b in ((x0, x1), (y0, y1)))
    pixels = np.stack(np.meshgrid(xs.ravel(), ys.ravel()), axis=-1).reshape(-1, 2)
    rays, eye, r = camera.rays(pixels), camera.eye, camera.radius
    centre = np.tile([place[0], place[1], r], (len(pixels), 1))
    if look.readout:
        late = moment + _delay(camera, look, pixels[:, 1]) - when
        centre[:, :2] += late[:, None] * velocity
    to = centre - eye
    along = np.sum(rays * to, axis=1)
    inside = r**2 - (np.sum(to**2, axis=1) - along**2)
    hit = inside > 0
    normal = (eye + (along - np.sqrt(np.maximum(inside, 0)))[:, None] * rays - centre) / r
    base = np.array(look.colours.get(name, BALLS.get(name.split("_")[0], BALLS["red"])))
    skin = np.tile(base, (len(pixels), 1))
    own = normal @ axes  # in the ball's axes
    for spot in look.spots.get(name, ()):
        skin[own @ _unit(spot.place) > np.cos(spot.angle)] = spot.colour
    light = _unit(look.light)
    shade = 0.45 + 0.55 * np.maximum(normal @ light, 0)
    mirror = rays - 2 * np.sum(rays * normal, axis=1, keepdims=True) * normal
    shine = look.gloss * np.maximum(mirror @ light, 0) ** 60
    colour = (
        np.minimum(skin * shade[:, None] + shine[:, None], 1) * brightness(camera, look, pixels)[:, None] * hit[:, None]
    )
    shape = (y1 - y0, FINE, x1 - x0, FINE)
    cover = hit.reshape(shape).mean(axis=(1, 3))[..., None]
    seen = colour.reshape(*shape, 3).mean(axis=(1, 3))
    return box, 1 - cover, seen


def _cue(camera: Camera, cue: Cue, moment: float, look: Look, picture: Light) -> None:
    """The cue as a tapered stick, its leather tip in another colour."""
    when = moment
    for _ in range(3 if look.readout else 1):
        row = float(np.clip(camera.project(cue.tip_at(when)[None])[0, 1], 0, camera.size[1] - 1))
        when = moment + float(_delay(camera, look, row))
    tip, back = cue.tip_at(when), -cue.direction
    side = _unit(np.cross([0, 0, 1.0], back))
    for begin, end, colour in ((0.0, 0.012, LEATHER), (0.012, cue.length, CUE_WOOD)):
        ways = np.linspace(begin, end, 2 if begin == 0 else 12)
        wide = 0.5 * (cue.tip + (cue.butt - cue.tip) * ways / cue.length)
        middle = tip + ways[:, None] * back
        edge = np.concatenate([middle + wide[:, None] * side, (middle - wide[:, None] * side)[::-1]])
        points = camera.project(edge)
        low = np.clip(np.floor(points.min(axis=0)).astype(int) - 1, 0, camera.size)
        high = np.clip(np.ceil(points.max(axis=0)).astype(int) + 2, 0, camera.size)
        if (high <= low).any():
            continue
        # OpenCV's own smooth edges lie half a pixel too far out: what covers a pixel is counted on a finer grid.
        w, h = high - low
        fine = np.zeros((h * CUE_FINE, w * CUE_FINE), np.uint8)
        corners = (points - low + 0.5) * CUE_FINE - 0.5
        cv2.fillPoly(fine, [np.rint(corners * 2**SHIFT).astype(np.int32)], 255, cv2.LINE_8, SHIFT)
        part = cv2.resize(fine.astype(np.float32) / 255, (int(w), int(h)), interpolation=cv2.INTER_AREA)[..., None]
        seen = picture[low[1] : high[1], low[0] : high[0]]
        seen *= 1 - part
        seen += part * np.array(colour, np.float32)
