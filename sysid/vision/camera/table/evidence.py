"""What speaks for a camera besides the noses that it was fitted to, and what speaks against it.

In: the camera, what is seen of the table, and the reading of its cushions. Out: notes, and doubts: the diamonds lie at
eighths of the length and quarters of the width, the balls are as large as they were said to be, no other edges could as
well be the noses, and the lens is one that is made.
"""

from __future__ import annotations

import numpy as np

from models.messages import counted
from sysid.vision.camera.projection import Camera
from sysid.vision.camera.table.noses import RAIL_RISE_M, CushionReading, TableEvidence, diamond_errors
from sysid.vision.camera.trust import TABLE_SIZE_REMEDY

MIN_LEAD = 9.0  # of a reading over the next one that differs: three standard deviations
MAX_COST = 16.0  # of a reading, sum of squares in standard deviations
MAX_DIAMOND_COST = 1.0  # more for each diamond
MAX_MARKER_COST = 3.0  # and for each marker
CUSHION_WIDTHS_M = (0.02, 0.068)  # of the cloth on cushions: usually 38 to 58 mm
MAX_DIAMOND_RMS_M = 5e-3  # of the diamonds along their rails
MAX_DIAMOND_RMS_PX = 1.5  # or this if it is more
MAX_BALL_SD = 2.5  # of the size of the balls from that expected
MAX_CHANGE_M = 8e-3  # of places between the reading and the final camera
FOV_DEG = (5.0, 125.0)  # of lenses that are not fisheyes, across the longer side of a picture
MAX_DISTORTION = 0.35  # of the distance from the middle, at the farthest corner of the table
LENS_REMEDY = "calibrate with --corners, or with a --board"


def evidence(camera: Camera, seen: TableEvidence, reading: CushionReading) -> list[str]:
    """What speaks for a camera, in lines."""
    found = []
    if len(seen.diamonds.pixels):
        rms = _diamond_rms(camera, seen, reading)
        found.append(f"{counted(len(seen.diamonds.pixels), 'diamond')} within {1e3 * rms:.1f} mm rms")
    ratio, sd = seen.balls.ratio(camera)
    if np.isfinite(ratio):
        size = f"{100 * (ratio - 1):+.0f} +- {100 * sd:.0f} % in size"
        found.append(f"{counted(len(seen.balls.radius), 'ball outline')}, {size}")
    if len(seen.markers):
        found.append(counted(len(seen.markers), "marker"))
    if found:
        return [f"checked by {' and by '.join(found)}"]
    return ["no diamonds and no balls were seen: the noses alone determine the camera"]


def unsure(seen: TableEvidence, reading: CushionReading) -> bool:
    """Whether another reading is about as likely, or what is seen does not go together."""
    return reading.lead < MIN_LEAD or reading.cost > _max_cost(seen)


def _max_cost(seen: TableEvidence) -> float:
    """Of a reading in which all that is seen goes together."""
    return MAX_COST + MAX_DIAMOND_COST * len(seen.diamonds.pixels) + MAX_MARKER_COST * len(seen.markers)


def evidence_doubts(camera: Camera, seen: TableEvidence, reading: CushionReading) -> list[str]:
    """What speaks against a camera."""
    return [
        *_reading_doubts(camera, reading, _max_cost(seen)),
        *_size_doubts(camera, seen, reading),
        *_lens_doubts(camera),
    ]


def _reading_doubts(camera: Camera, reading: CushionReading, max_cost: float) -> list[str]:
    """Doubts that the edges taken are the noses."""
    if reading.lead < MIN_LEAD:
        return [f"other edges beside the bed, such as of a shadow, may be the noses as well: {TABLE_SIZE_REMEDY}"]
    if reading.cost > max_cost:
        deviations = float(np.sqrt(reading.cost))
        text = f"noses, cloth edge, diamonds and balls contradict each other ({deviations:.0f} standard deviations)"
        return [f"{text}: {TABLE_SIZE_REMEDY}"]
    if not CUSHION_WIDTHS_M[0] < reading.cushion_width < CUSHION_WIDTHS_M[1]:
        text = f"the cloth on the cushions would be {1e3 * reading.cushion_width:.0f} mm wide, as behind a shadow"
        return [f"{text}: {TABLE_SIZE_REMEDY}"]
    pixels = reading.camera.outline(_corners(camera))
    change = np.linalg.norm(camera.centres(pixels) - _corners(camera), axis=1)
    if not change.max() < MAX_CHANGE_M:
        text = f"edge points and the rest of the evidence disagree by {1e3 * change.max():.0f} mm"
        return [f"{text}: {TABLE_SIZE_REMEDY}"]
    return []


def _size_doubts(camera: Camera, seen: TableEvidence, reading: CushionReading) -> list[str]:
    """Doubts that the table and the balls are as large as they were said to be."""
    messages = []
    pixel = camera.eye[2] / camera.matrix[0, 0]
    if len(seen.diamonds.pixels):
        error = _diamond_rms(camera, seen, reading)
        if error > max(MAX_DIAMOND_RMS_M, MAX_DIAMOND_RMS_PX * pixel):
            messages.append(f"the diamonds lie {1e3 * error:.0f} mm from the eighths of the table: {TABLE_SIZE_REMEDY}")
    ratio, sd = seen.balls.ratio(camera)
    if np.isfinite(ratio) and abs(np.log(ratio)) > MAX_BALL_SD * sd:
        messages.append(
            f"the size of the balls differs by {100 * (ratio - 1):+.0f} % from that expected on such a table: "
            "check the sizes of balls and table, or calibrate with --corners"
        )
    return messages


def _lens_doubts(camera: Camera) -> list[str]:
    """Doubts that such a lens is made."""
    fov = float(np.degrees(2 * np.arctan(max(camera.size) / 2 / camera.matrix[0, 0])))
    if not FOV_DEG[0] < fov < FOV_DEG[1]:
        return [f"no usual lens has a field of view of {fov:.0f} degrees: {LENS_REMEDY}"]
    seen = camera.axes @ np.column_stack([_corners(camera), np.zeros(4)]).T + camera.translation[:, None]
    square = float(np.max(np.sum((seen[:2] / seen[2]) ** 2, axis=0)))
    k1, k2, _, _, k3 = camera.distortion
    squares = np.linspace(0, square, 50)
    bend = k1 * squares + k2 * squares**2 + k3 * squares**3
    grows = 1 + 3 * k1 * squares + 5 * k2 * squares**2 + 7 * k3 * squares**3
    if np.abs(bend).max() > MAX_DISTORTION or grows.min() <= 0:
        return [f"no usual lens has a distortion of {100 * bend[np.argmax(np.abs(bend))]:+.0f} %: {LENS_REMEDY}"]
    return []


def _diamond_rms(camera: Camera, seen: TableEvidence, reading: CushionReading) -> float:
    """Of the diamonds along their rails, from eighths of its length and quarters of its width [m]."""
    along, _ = diamond_errors(camera, seen.diamonds, reading.diamond_margin, RAIL_RISE_M[0])
    return float(np.sqrt(np.mean(along**2)))


def _corners(camera: Camera) -> np.ndarray:
    """Places of balls in the corners: (4, 2) [m]."""
    return camera.table.corners(camera.radius)
