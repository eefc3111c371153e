"""One ball on the cloth, in small steps: slide, roll, sidespin, rest.

With the slip of the ball's lowest point u = v + omega x (-R z^), sliding obeys

    dv/dt = -mu_s g u^ + push - air        d omega_h/dt = (5 mu_s g / 2R) z^ x u^

and rolling (u = 0) obeys dv/dt = -mu_r g v^ + (5/7)(push - air). Sidespin falls at a constant rate in every state.
Source: Newton-Euler of a solid sphere; Marlow, The Physics of Pocket Billiards (1995). The two changes of state
(slide to roll, roll to rest) are landed on inside a step, so that the result converges as the step shrinks.
A ball that the cue made hop flies first. Left out: hops otherwise, and the cloth's own deformation.

Everything numba compiles from this file is called from Python only, never from another file's compiled code: numba's
cache looks at the date of the calling file alone and would keep an outdated copy.
"""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from tests.truth.effects import EFFECTS as EFFECTS

Array = NDArray[np.float64]
Modes = NDArray[np.int64]
Due = tuple[float, int, int, int]  # time used [s]; what is due, and for whom, as `_touched` says

GRAVITY: Final = 9.81  # [m/s^2]
# Columns of a ball's state: [m], [m/s], [rad/s], [rad]; angle rolled [rad], time left off the cloth [s], 1 if struck.
X, Y, VX, VY, WX, WY, WZ, THETA, ROLLED, AIR, STRUCK, WIDTH = range(12)
REST, SLIDE, ROLL, POTTED = range(4)
NOTHING, BALL, CUSHION = range(3)  # what ended an advance
TOUCH_SPEED: Final = 1e-3  # slower approaches are resting contacts, not impacts [m/s]
CREEP: Final = 5e-5  # a sliding ball rolls once full friction would end its slip in this time [s]


class Constants(NamedTuple):
    """The table's constants, and those of the hidden effects at the value where each vanishes; names in `effects.py`.

    Those of the camera and of what differs between clips are here too, so that one value says all of a clip set.
    """

    radius: float = 0.02625  # [m]
    mass: float = 0.1406  # [kg]
    mus: float = 0.212  # sliding friction [1] (Mathavan 2009: 0.178-0.245)
    mur: float = 0.0127  # rolling deceleration over g [1] (Mathavan 2009: 0.0126-0.0128)
    spin: float = 22.0  # sidespin deceleration [rad/s^2] (Robotic Billiards, 2015)
    ebb: float = 0.92  # ball-ball restitution, energetic [1]
    mubb: float = 0.05  # ball-ball friction [1] (Mathavan 2014)
    ec: float = 0.90  # ball-cushion restitution, energetic [1]
    muc: float = 0.14  # ball-cushion friction [1] (Mathavan 2010)
    tilt_x: float = 0.0  # slope of the table: gravity g*tilt_x along +x [rad]
    tilt_y: float = 0.0  # the same along +y [rad]
    nap: float = 0.0  # push of the cloth's nap over mur*g [1]
    nap_phi: float = 0.0  # direction of that push [rad]
    drag1: float = 0.0  # rolling deceleration per speed [1/s]
    drag2: float = 0.0  # air drag, deceleration per speed squared [1/m]
    contensou: float = 0.0  # lever by which sidespin shares the sliding friction [m]
    swerve: float = 0.0  # lateral acceleration of a rolling ball per sidespin [m/s]
    ec_v: float = 0.0  # fall of ec per approach speed above 1 m/s [s/m]
    mubb_b: float = 0.0  # mubb gains mubb_b*exp(-mubb_c*slip) [1]
    mubb_c: float = 1.088  # [s/m] (Alciatore's fit to Marlow)

    mus_v: float = 0.0  # mus falls by this share per slip speed above 1 m/s, never below 5 % of itself [s/m]
    spin_v: float = 0.0  # the sidespin's deceleration grows by this share per speed [s/m]
    muc_v: float = 0.0  # fall of muc per approach speed above 1 m/s [s/m]
    ebb_v: float = 0.0  # fall of ebb per approach speed above 1 m/s [s/m]
    cue_mass: float = 1.0  # mass and inertia of the struck ball over those of the others [1]
    off_centre: float = 0.0  # lateral acceleration over g of the rolling struck ball, times the sine of its turn [1]
    hop: float = 0.0  # the struck ball leaves the cloth for this time per speed of the strike [s^2/m]
    squirt: float = 0.0  # turn of the struck ball's path to the left per contact point to the right [rad/m]
    clock: float = 1.0  # time stamps over true times [1]
    lens: float = 0.0  # image shrinks by lens r^2 at distance r from the table's centre [1/m^2]
    camera_tilt: float = 0.0  # image is divided by 1 + k x + k/2 y [1/m]
    image_scale: float = 0.0  # image is larger by this share [1]
    image_aspect: float = 0.0  # image is longer along x, and shorter along y, by this share [1]
    shutter: float = 0.0  # a row is read later by this time per y [s/m]
    ripple: float = 0.0  # mur times 1 + ripple cos(2 (heading - ripple_phi)) [1]
    ripple_phi: float = 0.0  # [rad]
    slide_swerve: float = 0.0  # lateral acceleration of a sliding ball per sidespin and speed [1]
    cue_mus: float = 0.0  # mus of the struck ball is higher by this share [1]
    follow: float = 0.0  # share of what changes mus outside impacts that does so within them [1]
    cue_mur: float = 0.0  # mur of the struck ball is higher by this share [1]
    lens4: float = 0.0  # image shrinks by a further lens4 r^4 [1/m^4]
    patch: float = 0.0  # share by which rolling and sliding friction is higher on a worn patch [1]
    patch_x: float = 0.4  # its centre [m]
    patch_y: float = -0.2  # [m]
    patch_r: float = 0.35  # its radius [m]
    ec_px: float = 0.0  # ec of the rail at +x is more by this [1]
    ec_mx: float = 0.0  # of the rail at -x [1]
    ec_py: float = 0.0  # at +y [1]
    ec_my: float = 0.0  # at -y [1]
    muc_px: float = 0.0  # muc of the rail at +x is more by this [1]
    muc_mx: float = 0.0  # of the rail at -x [1]
    muc_py: float = 0.0  # at +y [1]
    muc_my: float = 0.0  # at -y [1]
    nose: float = 0.0  # all noses are higher than 7R/5 by this [R]
    nose_px: float = 0.0  # that at +x is higher than the others by this [R]
    nose_mx: float = 0.0  # at -x [R]
    nose_py: float = 0.0  # at +y [R]
    nose_my: float = 0.0  # at -y [R]
    compliance: float = 0.0  # of the noses along their face, over that along their normal; 0 is rigid [1]
    bed: float = 0.0  # share of a nose's push downwards that the slate does not return [1]
    contact: float = 0.0  # time for which a ball stays in a rail [s]
    crown: float = 0.0  # slope away from the table's centre per distance from it [rad/m]
    wear: float = 0.0  # share by which mur has grown from the first clip to the last [1]
    cling: float = 0.0  # share by which friction is higher where a ball meets the one named "red" [1]
    cling_share: float = 1.0  # share of the clips where it is so [1]
    ends: float = 0.0  # restitution that a cushion lacks at its ends, falling with the square of the way there [1]
    slow: float = 0.0  # mur times 1 + slow exp(-v / slow_v) [1]
    slow_v: float = 0.25  # [m/s]
    shake: float = 0.0  # amplitude of the camera's swing along x [m]
    shake_hz: float = 1.7  # its frequency [1/s]


@njit(cache=True)
def _push(s: Array, touching: float, c: Constants) -> tuple[float, float]:
    """Acceleration of a free ball by all that acts on its centre: slope, nap, air, crown [m/s^2].

    touching is 1, or 0 for a ball off the cloth, which neither nap nor crown pushes.
    """
    speed = np.hypot(s[VX], s[VY])
    nap = touching * c.nap * c.mur * GRAVITY
    crown = touching * GRAVITY * c.crown
    ax = GRAVITY * c.tilt_x + nap * np.cos(c.nap_phi) - c.drag2 * speed * s[VX] + crown * s[X]
    ay = GRAVITY * c.tilt_y + nap * np.sin(c.nap_phi) - c.drag2 * speed * s[VY] + crown * s[Y]
    return ax, ay


@njit(cache=True)
def _worn(s: Array, c: Constants) -> float:
    """Factor on the cloth's friction where the ball is [1]."""
    if c.patch != 0.0 and np.hypot(s[X] - c.patch_x, s[Y] - c.patch_y) < c.patch_r:
        return 1.0 + c.patch
    return 1.0


@njit(cache=True)
def _rolling_friction(s: Array, nx: float, ny: float, c: Constants) -> float:
    """Rolling deceleration over g where the ball is, towards the direction (nx, ny), at its speed [1]."""
    along = np.cos(2.0 * (np.arctan2(ny, nx) - c.ripple_phi))
    mur = c.mur * _worn(s, c) * (1.0 + c.ripple * along) * (1.0 + s[STRUCK] * c.cue_mur)
    if c.slow != 0.0:
        mur *= 1.0 + c.slow * np.exp(-np.hypot(s[VX], s[VY]) / c.slow_v)
    return mur


@njit(cache=True)
def _spin_decay(s: Array, c: Constants) -> float:
    """Deceleration of the sidespin [rad/s^2]."""
    return c.spin * (1.0 + c.spin_v * np.hypot(s[VX], s[VY]))


@njit(cache=True)
def sliding_friction(s: Array, ux: float, uy: float, c: Constants) -> float:
    """Sliding friction over slip speed of a ball whose lowest point slips at (ux, uy) [s/m]."""
    twist = c.contensou * s[WZ]
    total = np.sqrt(ux * ux + uy * uy + twist * twist)
    mus = max(0.05 * c.mus, c.mus * (1.0 - c.mus_v * (np.hypot(ux, uy) - 1.0))) * (1.0 + s[STRUCK] * c.cue_mus)
    return mus * _worn(s, c) / total if total > 0.0 else 0.0


@njit(cache=True)
def _slide_rates(s: Array, c: Constants) -> tuple[float, float, float, float, float]:
    """Rates of (vx, vy, wx, wy) and the deceleration of the sidespin of a sliding ball [m/s^2, rad/s^2].

    With a contensou lever b the friction is mu_s g u / sqrt(u^2 + (b omega_z)^2) and the sidespin decelerates by the
    other share, b |omega_z| over the same root: the first-order form of Contensou's law for a contact patch.
    """
    ux, uy = s[VX] - c.radius * s[WY], s[VY] + c.radius * s[WX]
    twist = c.contensou * s[WZ]
    total = np.sqrt(ux * ux + uy * uy + twist * twist)
    friction = GRAVITY * sliding_friction(s, ux, uy, c)
    side, speed = c.slide_swerve * s[WZ], np.hypot(s[VX], s[VY])
    gripped = friction * np.hypot(ux, uy)  # Coulomb: no more across than there is against the slip
    if abs(side) * speed > gripped:
        side = np.sign(side) * gripped / speed
    fx, fy = friction * ux + side * s[VY], friction * uy - side * s[VX]
    decay = _spin_decay(s, c)
    decay *= abs(twist) / total if c.contensou > 0.0 and total > 0.0 else 1.0
    ax, ay = _push(s, 1.0, c)
    return ax - fx, ay - fy, -2.5 * fy / c.radius, 2.5 * fx / c.radius, decay


@njit(cache=True)
def _roll_rates(s: Array, c: Constants) -> tuple[float, float]:
    """Rates of (vx, vy) of a rolling ball [m/s^2]."""
    px, py = _push(s, 1.0, c)
    px, py = 5.0 / 7.0 * px, 5.0 / 7.0 * py
    speed = np.hypot(s[VX], s[VY])
    # A ball at the point of leaving rest is braked against where it is pushed.
    nx, ny = (s[VX], s[VY]) if speed > 0.0 else (px, py)
    size = np.hypot(nx, ny)
    if size == 0.0:
        return 0.0, 0.0
    nx, ny = nx / size, ny / size
    brake = _rolling_friction(s, nx, ny, c) * GRAVITY + c.drag1 * speed
    side = c.swerve * s[WZ] + s[STRUCK] * GRAVITY * c.off_centre * np.sin(s[ROLLED]) if speed > 0.0 else 0.0
    return px - brake * nx - side * ny, py - brake * ny + side * nx


@njit(cache=True)
def _turn(s: Array, decay: float, h: float) -> None:
    """Let the sidespin fall by decay [rad/s^2] for h [s], ending at 0, and add up the turned angle."""
    wz = s[WZ]
    ends = abs(wz) < decay * h
    lasting = abs(wz) / decay if ends else h
    after = 0.0 if ends else wz - np.sign(wz) * decay * h
    s[THETA] += 0.5 * (wz + after) * lasting
    s[WZ] = after


@njit(cache=True)
def _slide(s: Array, h: float, c: Constants) -> None:
    """Midpoint step of a sliding ball."""
    ax, ay, bx, by, decay = _slide_rates(s, c)
    mid = s.copy()
    mid[VX] += 0.5 * h * ax
    mid[VY] += 0.5 * h * ay
    mid[WX] += 0.5 * h * bx
    mid[WY] += 0.5 * h * by
    _turn(mid, decay, 0.5 * h)
    ax, ay, bx, by, decay = _slide_rates(mid, c)
    s[X] += h * mid[VX]
    s[Y] += h * mid[VY]
    s[VX] += h * ax
    s[VY] += h * ay
    s[WX] += h * bx
    s[WY] += h * by
    _turn(s, decay, h)


@njit(cache=True)
def _roll(s: Array, h: float, c: Constants) -> None:
    """Midpoint step of a rolling ball."""
    ax, ay = _roll_rates(s, c)
    mid = s.copy()
    mid[VX] += 0.5 * h * ax
    mid[VY] += 0.5 * h * ay
    mid[ROLLED] += 0.5 * h * np.hypot(s[VX], s[VY]) / c.radius
    _turn(mid, _spin_decay(s, c), 0.5 * h)
    ax, ay = _roll_rates(mid, c)
    s[X] += h * mid[VX]
    s[Y] += h * mid[VY]
    s[VX] += h * ax
    s[VY] += h * ay
    s[WX] = -s[VY] / c.radius
    s[WY] = s[VX] / c.radius
    s[ROLLED] += h * np.hypot(mid[VX], mid[VY]) / c.radius
    _turn(s, _spin_decay(mid, c), h)


@njit(cache=True)
def _fly(s: Array, h: float, c: Constants) -> None:
    """Midpoint step of a ball off the cloth: only slope and air act on it."""
    ax, ay = _push(s, 0.0, c)
    mid = s.copy()
    mid[VX] += 0.5 * h * ax
    mid[VY] += 0.5 * h * ay
    ax, ay = _push(mid, 0.0, c)
    s[X] += h * mid[VX]
    s[Y] += h * mid[VY]
    s[VX] += h * ax
    s[VY] += h * ay
    s[THETA] += h * s[WZ]
    s[AIR] -= h


@njit(cache=True)
def _time_to_roll(s: Array, c: Constants) -> float:
    """When the slip will end at its present rate [s]; 0 when it has, inf when it grows."""
    ux = s[VX] - c.radius * s[WY]
    uy = s[VY] + c.radius * s[WX]
    slip = np.hypot(ux, uy)
    # Where sidespin shares the friction, slip dies exponentially and would never end by itself.
    if slip < 1e-12 or (c.contensou > 0.0 and slip < 3.5 * c.mus * GRAVITY * CREEP):
        return 0.0
    ax, ay, bx, by, _ = _slide_rates(s, c)
    rate = ((ax - c.radius * by) * ux + (ay + c.radius * bx) * uy) / slip
    return slip / -rate if rate < 0.0 else np.inf


@njit(cache=True)
def _time_to_stop(s: Array, c: Constants) -> float:
    """When a rolling ball will stop at its present deceleration [s]; inf when it does not slow down."""
    speed = np.hypot(s[VX], s[VY])
    ax, ay = _roll_rates(s, c)
    if speed == 0.0:
        px, py = _push(s, 1.0, c)
        return 0.0 if ax * px + ay * py <= 0.0 else np.inf
    rate = (ax * s[VX] + ay * s[VY]) / speed
    return speed / -rate if rate < 0.0 else np.inf


@njit(cache=True)
def _move(s: Array, mode: int, h: float, c: Constants) -> int:
    """Advance one ball by h [s], changing its state where that falls; the new mode."""
    left = h
    while left > 0.0:
        if s[AIR] > 0.0:
            due = s[AIR]
            _fly(s, min(left, due), c)
            if due <= left:
                s[AIR] = 0.0
        elif mode == SLIDE:
            due = _time_to_roll(s, c)
            _slide(s, min(left, due), c)
            if due <= left:
                # What slip is left is second order in the step: roll with the momentum about the contact kept.
                s[VX] -= 2.0 / 7.0 * (s[VX] - c.radius * s[WY])
                s[VY] -= 2.0 / 7.0 * (s[VY] + c.radius * s[WX])
                mode = ROLL
        elif mode == ROLL:
            due = _time_to_stop(s, c)
            _roll(s, min(left, due), c)
            if due <= left:
                s[VX], s[VY], s[WX], s[WY] = 0.0, 0.0, 0.0, 0.0
                px, py = _push(s, 1.0, c)
                size = np.hypot(px, py)
                nx, ny = (px / size, py / size) if size > 0.0 else (1.0, 0.0)
                if 5.0 / 7.0 * size <= _rolling_friction(s, nx, ny, c) * GRAVITY:
                    mode = REST
        else:
            due = left
            _turn(s, _spin_decay(s, c), left)
        left -= min(left, due)
    return mode


@njit(cache=True)
def _touched(s: Array, mode: Modes, radius: float, reach: Array) -> tuple[int, int, int]:
    """The first impact that is due: (BALL, i, j) or (CUSHION, i, rail); rails 0..3 are +x, -x, +y, -y."""
    for i in range(len(s)):
        if mode[i] == POTTED:
            continue
        for axis in range(2):
            p, v = s[i, X + axis], s[i, VX + axis]
            if p > reach[axis] and v > TOUCH_SPEED:
                return CUSHION, i, 2 * axis
            if p < -reach[axis] and v < -TOUCH_SPEED:
                return CUSHION, i, 2 * axis + 1
        for j in range(i):
            if mode[j] == POTTED or (mode[i] == REST and mode[j] == REST):
                continue
            dx, dy = s[i, X] - s[j, X], s[i, Y] - s[j, Y]
            gap2 = dx * dx + dy * dy
            if gap2 < 4.0 * radius * radius:
                closing = dx * (s[i, VX] - s[j, VX]) + dy * (s[i, VY] - s[j, VY])
                if -closing > TOUCH_SPEED * np.sqrt(gap2):
                    return BALL, j, i
    return NOTHING, 0, 0


@njit(cache=True)
def _lean(s: Array, mode: Modes, reach: Array) -> None:
    """Hold balls that press on a cushion too slowly for an impact."""
    for i in range(len(s)):
        if mode[i] != POTTED:
            for axis in range(2):
                p = s[i, X + axis]
                if abs(p) > reach[axis] and p * s[i, VX + axis] > 0.0:
                    s[i, X + axis] = np.sign(p) * reach[axis]
                    s[i, VX + axis] = 0.0


@njit(cache=True)
def advance(s: Array, mode: Modes, c: Constants, reach: Array, duration: float, step: float) -> Due:
    """Move all balls until an impact is due or duration [s] has passed, in equal steps of at most step [s].

    s: (n, WIDTH) states and mode: (n,) change in place; reach: (2,) largest |x|, |y| of a centre [m].
    Returns the time used [s] and what is due as in `_touched`. The instant is bisected within its step.
    """
    kind, i, j = _touched(s, mode, c.radius, reach)
    if kind != NOTHING:
        return 0.0, kind, i, j
    steps = max(1, int(np.ceil(duration / step - 1e-9)))
    h = duration / steps
    for k in range(steps):
        before, mode_before = s.copy(), mode.copy()
        low, high, part = 0.0, h, h
        for trial in range(42):
            for b in range(len(s)):
                for column in range(WIDTH):  # as an array assignment it would take 4 s more to compile
                    s[b, column] = before[b, column]
                if mode[b] != POTTED:
                    mode[b] = _move(s[b], mode_before[b], part, c)
            kind, i, j = _touched(s, mode, c.radius, reach)
            if kind != NOTHING:
                high = part
            elif trial == 0:
                break
            else:
                low = part
            part = 0.5 * (low + high) if trial < 40 else high
        if kind != NOTHING:
            return k * h + high, kind, i, j
        _lean(s, mode, reach)
    return duration, NOTHING, 0, 0
