"""Whether a camera still stands where it was calibrated: the table's sides, looked at again in later pictures.

In: a picture and its camera. Out: brightness across the noses at places along each side, which the camera file keeps.
In another picture each of these profiles is found again, somewhat farther out or in (normalised correlation), and the
pose is fitted to where. Hands, balls and cues cover some of the places only, and do not agree on one pose. Pictures of
a film are then laid where they would be if the camera stood still.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from models.errors import BadInput
from models.shot import NOSE_HEIGHT
from sysid.vision.camera.pose import fit_camera
from sysid.vision.camera.projection import SIDE_PROFILES, Array, Camera
from sysid.vision.frames import Frame
from sysid.vision.sources.pictures import Picture

# Places between diamonds, which are at eighths, and away from pockets; in lengths of a side.
PLACE_SHARES = np.array([5, 7, 9, 11, 13, 19, 21, 23, 25, 27]) / 32
STEP_M = 2.5e-3  # of a profile,
INSIDE_M = 0.03  # which begins so far inside of the nose
SEARCH_M = 0.06  # farther in or out, where a profile is looked for
ALONG_M = 0.03  # of a side, over which a profile is averaged,
ALONG_SAMPLES = 9  # at so many points
MIN_CONTRAST = 6.0  # standard deviation of a profile, below which it shows nothing [grey levels]
MIN_SAMPLES = 20  # of a profile in the picture,
MIN_COVER = 0.7  # and of these, that are in another
MAX_GAIN = 4.0  # of the light, either way
MIN_LIKENESS = 0.9  # normalised correlation of a profile with what it is found at
MIN_PLACES = 16  # that must show something, at three sides or more, to know whether a camera stands
MIN_FOUND, MIN_FOUND_SIDE = 0.5, 0.2  # of these, found again where one pose has them: of all, and of each side
MIN_SIDE = 5  # that show something, for a side to count
MAX_RESIDUAL_PX = 1.0  # of that pose, rms
MIN_SHIFT_M, MIN_SHIFT_PX = 0.15e-3, 0.1  # of the middle one of the places, below which the camera stands as it did
SETTLED_M = 1e-3  # of the pose found: farther off, the profiles are looked for once more, from there
MAX_ROUNDS = 4  # of this, at most
MAX_FOLLOWED_M = 0.03  # by which a camera may have moved since it was calibrated, rms over the table,
MAX_UNSEEN_M, MAX_UNSEEN_PX = 1.5e-3, 0.8  # and within a film while the sides are hidden, by the greater of both


class SideView:
    """The sides of the table as a camera saw them when it was calibrated."""

    def __init__(self, camera: Camera, profiles: NDArray[np.uint8]) -> None:
        """Of a camera and its profiles."""
        self._camera, self._profiles = camera, profiles.astype(float)
        self._known, self._shows = profiles > 0, _shows(profiles)
        self._shifts = np.arange(-round(SEARCH_M / STEP_M), round(SEARCH_M / STEP_M) + 1) * STEP_M
        self._lines = _lines(camera, SEARCH_M)

    def camera_in(self, pictures: Sequence[Picture]) -> Camera | None:
        """The camera where it stands in most of some pictures; None where too little of the sides is found."""
        return self.look(pictures)[0]

    def look(self, pictures: Sequence[Picture]) -> tuple[Camera | None, bool]:
        """See `camera_in`; and whether any side of the table is found: where none is, pictures show another view."""
        out, likeness = self._found(_light(pictures, self._lines))
        good = likeness >= MIN_LIKENESS
        sides = self._sides(good)
        return (self._there(out, good) if self._enough(good) else None), bool(sides.any()) or not sides.size

    def _there(self, out: Array, good: NDArray[np.bool_]) -> Camera | None:
        """The camera from how far out its profiles (places,) are found."""
        xy, rails = _places(self._camera)
        if np.median(np.abs(out[good])) < max(MIN_SHIFT_M, MIN_SHIFT_PX * self._camera.pixel):
            return self._camera
        axis, sign = rails // 2, 1.0 - 2.0 * (rails % 2)
        xy[np.arange(len(xy)), axis] += sign * out
        places = np.column_stack([xy, np.full(len(xy), NOSE_HEIGHT * self._camera.radius)])
        fit = fit_camera(self._camera, self._camera.project(places[good]), rails[good])
        good[good] = fit.kept
        return fit.camera if self._enough(good) and fit.reprojection_error < MAX_RESIDUAL_PX else None

    def _sides(self, found: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Whether enough of the places (places,) are found on each side that shows something."""
        shows, found = self._shows.reshape(4, -1).sum(axis=1), found.reshape(4, -1).sum(axis=1)
        return np.asarray((found >= MIN_FOUND_SIDE * shows)[shows >= MIN_SIDE])

    def _enough(self, found: NDArray[np.bool_]) -> bool:
        """Whether so many of the places (places,) are found that it is this table, seen by this camera."""
        few = found.sum() < MIN_FOUND * self._shows.sum()
        return bool(self._sides(found).all()) and _can_tell(self._shows) and not few

    def _found(self, light: Array) -> tuple[Array, Array]:
        """How far out each profile is found (places,) [m], and its correlation there (places,); -1 for none."""
        windows = np.lib.stride_tricks.sliding_window_view(light, self._profiles.shape[1], axis=1)
        both = np.isfinite(windows) & self._known[:, None]  # (places, shifts, samples)
        count = both.sum(axis=2)
        ours, theirs = np.where(both, self._profiles[:, None], 0.0), np.where(both, windows, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            ours = np.where(both, ours - ours.sum(axis=2, keepdims=True) / count[..., None], 0.0)
            theirs = np.where(both, theirs - theirs.sum(axis=2, keepdims=True) / count[..., None], 0.0)
            contrast = np.sqrt((ours**2).sum(axis=2) / count)
            their_contrast = np.sqrt((theirs**2).sum(axis=2) / count)
            likeness = (ours * theirs).sum(axis=2) / count / contrast / their_contrast
            gain = their_contrast / contrast
        enough = count >= MIN_COVER * self._known.sum(axis=1, keepdims=True)
        like = enough & (contrast >= MIN_CONTRAST) & (gain > 1 / MAX_GAIN) & (gain < MAX_GAIN)
        likeness = np.where(like & self._shows[:, None], np.nan_to_num(likeness), -1.0)
        best = np.clip(likeness.argmax(axis=1), 1, likeness.shape[1] - 2)
        before, at, after = (likeness[np.arange(len(best)), best + k] for k in (-1, 0, 1))
        curve = np.minimum(before - 2 * at + after, -1e-9)
        peak = (at >= before) & (at >= after) & (np.minimum(before, after) > -1)  # and not where the picture ends
        return self._shifts[best] + STEP_M * 0.5 * (before - after) / curve, np.where(peak, at, -1.0)


def _shows(profiles: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Which profiles show something that can be found again: (places,)."""
    known = np.where(profiles > 0, profiles.astype(float), np.nan)
    seen = np.isfinite(known).sum(axis=1)
    known[seen == 0] = 0.0
    return np.asarray((seen >= MIN_SAMPLES) & (np.nanstd(known, axis=1) >= MIN_CONTRAST))


def _can_tell(shows: NDArray[np.bool_]) -> bool:
    """Whether places that show something (places,) are so many that a camera's place is known by them."""
    return bool(shows.sum() >= MIN_PLACES and (shows.reshape(4, -1).sum(axis=1) >= MIN_SIDE).sum() >= 3)


class SteadyView:
    """Lays a film's pictures where its camera would have them if it stood where it does in most of the film.

    A mount that sways, a stabiliser or a converter of fields move the whole picture, often by a pixel back and forth.
    """

    def __init__(self, camera: Camera) -> None:
        """Of a camera as `standing` returns it."""
        self._camera = self._last = camera
        self._view = None if camera.sides is None else SideView(camera, camera.sides)
        self._limit = max(MAX_UNSEEN_M, MAX_UNSEEN_PX * camera.pixel)
        half = np.array([camera.table.length, camera.table.width]) / 2
        self._corners = np.column_stack([[(1, 1), (1, -1), (-1, -1), (-1, 1)] * half, np.full(4, camera.radius)])
        self._cameras: dict[int, Camera] = {}  # of every frame: where it was taken; unseen, as the one before
        self._seen: list[int] = []  # frames in which the sides were found
        self._elsewhere: set[int] = set()  # frames in which no side was

    def steady(self, frame: Frame) -> Frame:
        """The frame as the camera would show it from its usual place."""
        if self._view is None:
            return frame
        if frame.index not in self._cameras:
            found, shows = self._view.look([frame.picture])
            if not shows:
                self._elsewhere.add(frame.index)
            if found is not None:
                self._last = found
                self._seen.append(frame.index)
            self._cameras[frame.index] = self._last
        there = self._cameras[frame.index]
        frame = dataclasses.replace(frame, elsewhere=frame.index in self._elsewhere)
        if there is self._camera:
            return frame
        usual, now = (camera.project(self._corners).astype(np.float32) for camera in (self._camera, there))
        picture = cv2.warpPerspective(
            frame.picture, cv2.getPerspectiveTransform(usual, now), self._camera.size,
            flags=cv2.INTER_CUBIC | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REPLICATE,
        )  # fmt: skip
        return dataclasses.replace(frame, picture=np.asarray(picture, np.uint8))

    def moved_unseen(self, first: int, last: int) -> float:
        """How far the camera moves between two frames while too little of the sides is seen: rms over the table [m].

        0 where it stays, or is seen in all frames.
        """
        seen = np.array(self._seen, int)
        hidden = (np.diff(seen) > 1) & (seen[:-1] < last) & (seen[1:] > first)
        ends = [(self._cameras[seen[k]], self._cameras[seen[k + 1]]) for k in np.flatnonzero(hidden)]
        far = max((apart(before, after) for before, after in ends if before is not after), default=0.0)
        return far if far > self._limit else 0.0


def standing(camera: Camera, pictures: Sequence[Picture]) -> tuple[Camera, tuple[str, ...]]:
    """The camera where it stands in pictures, with their profiles of the sides, and what is to be said of it.

    Raises:
        BadInput: the table's sides are not where the camera has them.
    """
    found = camera
    said: tuple[str, ...] = ()
    if camera.sides is not None and _can_tell(_shows(camera.sides)):
        for _ in range(MAX_ROUNDS):
            seen = SideView(found, camera.sides).camera_in(pictures)
            if seen is None or apart(camera, seen) > MAX_FOLLOWED_M:
                raise BadInput("shows the table elsewhere than the camera file says; calibrate the camera again")
            found, before = seen, found
            if apart(found, before) < SETTLED_M:
                break
        if found is not camera:
            said = (f"the camera stands {1e3 * apart(camera, found):.1f} mm from where it was calibrated: corrected",)
    return dataclasses.replace(found, sides=side_profiles(pictures, found)), said


def side_profiles(pictures: Sequence[Picture], camera: Camera) -> NDArray[np.uint8]:
    """Brightness across the noses where a camera stands: (places, samples), 1 to 255; 0 out of the picture."""
    light = _light(pictures, _lines(camera, 0.0))
    return np.where(np.isfinite(light), np.rint(np.clip(np.nan_to_num(light), 1, 255)), 0).astype(np.uint8)


def apart(one: Camera, other: Camera) -> float:
    """Between the places that two cameras give to the same balls: rms over the table [m]."""
    half = np.array([one.table.length, one.table.width]) / 2 - one.radius
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, 7), np.linspace(-1, 1, 5)), axis=-1).reshape(-1, 2) * half
    return float(np.sqrt(np.mean(np.sum((other.centres(one.outline(grid)) - grid) ** 2, axis=1))))


def _places(camera: Camera) -> tuple[Array, NDArray[np.intp]]:
    """Where profiles cross the noses (places, 2) [m], and the rail there (places,)."""
    half = np.array([camera.table.length, camera.table.width]) / 2
    rails = np.repeat(np.arange(4), len(PLACE_SHARES))
    axis, sign, rows = rails // 2, 1.0 - 2.0 * (rails % 2), np.arange(len(rails))
    xy = np.empty((len(rails), 2))
    xy[rows, axis], xy[rows, 1 - axis] = sign * half[axis], (2 * np.tile(PLACE_SHARES, 4) - 1) * half[1 - axis]
    return xy, rails


def _lines(camera: Camera, search: float) -> NDArray[np.float32]:
    """Pixels of the points of profiles that go so much farther in and out [m]: (places, samples, along, 2)."""
    xy, rails = _places(camera)
    axis, sign, rows = rails // 2, 1.0 - 2.0 * (rails % 2), np.arange(len(rails))
    beyond = round(search / STEP_M)
    across = np.arange(-beyond, SIDE_PROFILES[1] + beyond) * STEP_M - INSIDE_M
    along = np.linspace(-0.5, 0.5, ALONG_SAMPLES) * ALONG_M
    points = np.empty((len(xy), len(across), len(along), 3))
    points[..., :2], points[..., 2] = xy[:, None, None], NOSE_HEIGHT * camera.radius
    points[rows, :, :, axis] += sign[:, None, None] * across[None, :, None]
    points[rows, :, :, 1 - axis] += along[None, None, :]
    return camera.project(points).astype(np.float32).reshape(*points.shape[:3], 2)


def _light(pictures: Sequence[Picture], lines: NDArray[np.float32]) -> Array:
    """Brightness at such points, averaged along the sides, the median of pictures: (places, samples) [grey levels].

    NaN out of the picture.
    """
    flat = lines.reshape(-1, lines.shape[2], 2)
    seen = []
    for picture in pictures:
        grey = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY).astype(np.float32)
        light = cv2.remap(grey, flat, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=np.nan)
        seen.append(light.mean(axis=1))
    return np.asarray(np.median(seen, axis=0).reshape(lines.shape[:2]), float)
