"""From films to clips: camera, balls, tracks, turned angle, cue. Other rooms come in by the names below alone.

In: films, pictures, sizes of table and balls. Out: cameras, clips of shots, balls at rest, the films of a clip set.
"""

from typing import TYPE_CHECKING

from models.lazy import lazy

if TYPE_CHECKING:
    from sysid.vision.calibration import FoundCamera, NoCamera, calibrate
    from sysid.vision.camera.board import Board
    from sysid.vision.camera.calibrate import CameraHints
    from sysid.vision.camera.projection import Camera, read_camera, write_camera

__all__ = ["Board", "Camera", "CameraHints", "FoundCamera", "NoCamera", "calibrate", "read_camera", "write_camera"]
__getattr__, __dir__ = lazy(
    __name__,
    {
        "Board": "sysid.vision.camera.board:Board",
        "Camera": "sysid.vision.camera.projection:Camera",
        "CameraHints": "sysid.vision.camera.calibrate:CameraHints",
        "FoundCamera": "sysid.vision.calibration:FoundCamera",
        "NoCamera": "sysid.vision.calibration:NoCamera",
        "calibrate": "sysid.vision.calibration:calibrate",
        "read_camera": "sysid.vision.camera.projection:read_camera",
        "write_camera": "sysid.vision.camera.projection:write_camera",
    },
)
