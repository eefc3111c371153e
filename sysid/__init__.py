"""From tracked shots to a fitted model: the verbs of the `sysid` command as functions.

    import sysid

    clips = sysid.read_clips("clips")   # or sysid.import_tracks(files, table), sysid.track(video, camera)
    comparison = sysid.compare(clips)   # the base model as it is, or compare(clips, model)
    fitted = sysid.fit(clips)           # .model, .constants, .converged, .save("model.toml")
    diagnosis = sysid.diagnose(clips)   # .verdict, .ranking, .unexplained, .next_shot
    found = sysid.discover(clips)       # .verdict, .model, .last, .unexplained, .save("out")
    sysid.export(found, "table.xml")    # the table as plain MJCF, for any MuJoCo

All results are frozen values; arrays are NumPy's, in SI. They print as short tables, display in notebooks, convert to
data frames (`.frame()`), and write a report (`.report("page.html")`). A faulty file or value raises
`models.BadInput`. Long work reports its progress to the logger "sysid".
"""

from typing import TYPE_CHECKING

from models.lazy import lazy

if TYPE_CHECKING:
    from sysid.clips import Clip, ClipSet
    from sysid.clips import check_clip_set as check_clips
    from sysid.clips import read_clip_set as read_clips
    from sysid.clips import write_clip_set as write_clips
    from sysid.interface import compare, diagnose, discover, export, fit
    from sysid.sources import import_tracks, track

__all__ = [
    "Clip", "ClipSet", "check_clips", "compare", "diagnose", "discover", "export", "fit", "import_tracks", "read_clips",
    "track", "write_clips",
]  # fmt: skip
__getattr__, __dir__ = lazy(
    __name__,
    {
        "Clip": "sysid.clips:Clip",
        "ClipSet": "sysid.clips:ClipSet",
        "check_clips": "sysid.clips:check_clip_set",
        "compare": "sysid.interface:compare",
        "diagnose": "sysid.interface:diagnose",
        "discover": "sysid.interface:discover",
        "export": "sysid.interface:export",
        "fit": "sysid.interface:fit",
        "import_tracks": "sysid.sources:import_tracks",
        "read_clips": "sysid.clips:read_clip_set",
        "track": "sysid.sources:track",
        "write_clips": "sysid.clips:write_clip_set",
    },
)
