"""From films to clips: camera, balls, tracks, turned angle, cue. Other rooms come in by the names below alone.

calibrate(films, table, diameter)      a `FoundCamera`, or `NoCamera`, which shows what was seen; `read_camera`
track_film(film, Taken.of(camera))     a `TrackedFilm`, whose clips are a clip set; `FilmSet` for several films
find_balls(photo, camera)              the balls that lie on the table
films_of(clip_set)                     the films that clips are from, for recordings
cue_direction(picture, camera, ...)    a cue at rest behind a ball
Device(name)                           a live camera, and how its film is written and read
"""

from typing import TYPE_CHECKING

from models.lazy import lazy

if TYPE_CHECKING:
    from sysid.vision.calibration import FoundCamera, NoCamera, calibrate
    from sysid.vision.camera.board import Board
    from sysid.vision.camera.printed.marker_sheet import write_markers
    from sysid.vision.camera.projection import Camera, ball_of, read_camera, write_camera
    from sysid.vision.camera.table.reading import CameraHints
    from sysid.vision.cue.line import CueLine, angle_between, cue_direction
    from sysid.vision.device import Device, lossless_writer, stamped_footage
    from sysid.vision.film import Taken, TrackedFilm, track_film, track_footage
    from sysid.vision.film_set import FilmSet
    from sysid.vision.films import film_entries, films_of, missing_line
    from sysid.vision.frames import Footage
    from sysid.vision.sources.pictures import Picture
    from sysid.vision.still_balls import StillBall, find_balls

__all__ = [
    "Board",
    "Camera",
    "CameraHints",
    "CueLine",
    "Device",
    "FilmSet",
    "Footage",
    "FoundCamera",
    "NoCamera",
    "Picture",
    "StillBall",
    "Taken",
    "TrackedFilm",
    "angle_between",
    "ball_of",
    "calibrate",
    "cue_direction",
    "film_entries",
    "films_of",
    "find_balls",
    "lossless_writer",
    "missing_line",
    "read_camera",
    "stamped_footage",
    "track_film",
    "track_footage",
    "write_camera",
    "write_markers",
]
__getattr__, __dir__ = lazy(
    __name__,
    {
        "Board": "sysid.vision.camera.board:Board",
        "Camera": "sysid.vision.camera.projection:Camera",
        "CameraHints": "sysid.vision.camera.table.reading:CameraHints",
        "CueLine": "sysid.vision.cue.line:CueLine",
        "Device": "sysid.vision.device:Device",
        "FilmSet": "sysid.vision.film_set:FilmSet",
        "Footage": "sysid.vision.frames:Footage",
        "FoundCamera": "sysid.vision.calibration:FoundCamera",
        "NoCamera": "sysid.vision.calibration:NoCamera",
        "Picture": "sysid.vision.sources.pictures:Picture",
        "StillBall": "sysid.vision.still_balls:StillBall",
        "Taken": "sysid.vision.film:Taken",
        "TrackedFilm": "sysid.vision.film:TrackedFilm",
        "angle_between": "sysid.vision.cue.line:angle_between",
        "ball_of": "sysid.vision.camera.projection:ball_of",
        "calibrate": "sysid.vision.calibration:calibrate",
        "cue_direction": "sysid.vision.cue.line:cue_direction",
        "film_entries": "sysid.vision.films:film_entries",
        "films_of": "sysid.vision.films:films_of",
        "find_balls": "sysid.vision.still_balls:find_balls",
        "lossless_writer": "sysid.vision.device:lossless_writer",
        "missing_line": "sysid.vision.films:missing_line",
        "read_camera": "sysid.vision.camera.projection:read_camera",
        "stamped_footage": "sysid.vision.device:stamped_footage",
        "track_film": "sysid.vision.film:track_film",
        "track_footage": "sysid.vision.film:track_footage",
        "write_camera": "sysid.vision.camera.projection:write_camera",
        "write_markers": "sysid.vision.camera.printed.marker_sheet:write_markers",
    },
)
