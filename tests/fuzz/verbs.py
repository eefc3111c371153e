"""Command lines that read the seeds, and what they may write.

In a command line `{name}` is a file or folder of the seeds, or one that the verb may write (`out...`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

SEEDS = Path(__file__).with_name("seeds")


@dataclass(frozen=True)
class Verb:
    """A command line and the files of the seeds that it reads."""

    line: str
    reads: tuple[str, ...]  # relative paths of what is damaged
    share: int = 1  # how often it is chosen
    writes: tuple[str, ...] = ()  # seeds that it may change
    draws: bool = False  # a picture of what it understood, which stays where it refuses the rest

    @property
    def words(self) -> list[str]:
        """The words of the command line."""
        return self.line.split()


@dataclass(frozen=True)
class Command:
    """A command line, and the files that differ from the seeds."""

    verb: Verb
    words: tuple[str, ...]
    files: Mapping[str, bytes]


CLIPS = ("clips/clips.toml", "clips/clips/0001.csv", "clips/clips/0003.csv", "clips/clips/0004.csv")
PICTURES = ("pictures/0000.png", "pictures/0001.png")
SHOTS = tuple(f"learn/shots/000{n}{kind}.json" for n in (1, 2) for kind in ("", ".played", ".repeats"))
REFIT = ("learn/fits/0002/fit.json", "learn/fits/0002/model.toml", "learn/fits/0002/map.toml")
SERIES = (
    "learn/course.json",
    "learn/ended.txt",
    *SHOTS,
    REFIT[0],
    "learn/clips/clips.toml",
    "learn/clips/clips/0001.csv",
)
SIZES = "--table 3.569x1.778 --diameter 0.0525"
VERBS = (
    Verb("sysid check clips", CLIPS, 6),
    Verb("sysid compare clips", CLIPS, 4),
    Verb("sysid compare clips --model model.toml --json out.json", (*CLIPS, "model.toml", "model.toml"), 4),
    Verb("sysid fit clips --out out.toml", CLIPS),
    Verb("sysid measure clips --json out.json", CLIPS, 2),
    Verb("sysid diagnose clips --model model.toml", CLIPS),
    Verb("sysid discover clips --out found --overwrite", (*CLIPS, "found/unfinished.jsonl"), 1, ("found/",)),
    Verb("sysid plot clips --clip 3 --model model.toml --out out.png", (*CLIPS, "model.toml")),
    Verb(f"sysid import track.csv {SIZES} --unit m --origin centre --x-along length --fps 60 --out out",
         ("track.csv",), 6, draws=True),
    Verb(f"sysid import track.json {SIZES} --unit m --origin corner --x-along length --fps 60 --out out",
         ("track.json",), 6, draws=True),
    Verb(f"sysid import track.parquet {SIZES} --unit m --origin centre --x-along length --fps 60 --out out",
         ("track.parquet",), 4, draws=True),
    Verb("sysid review clips --save out.rrd", CLIPS),
    Verb("sysid export native.toml --out out.xml --balls white,red --bare", ("native.toml",), 2),
    Verb("sysid add squirt --model model.toml --out out.toml", ("model.toml",), 6),
    Verb("sysid remove slide_friction_speed --model learn/fits/0002/model.toml --out out.toml", REFIT[1:2], 4),
    Verb("sysid init out --table snooker", ()),
    Verb("sysid markers --table snooker --out out.pdf", ()),
    Verb("sysid new-effect mine --from result.json --dir out", ("result.json",), 6),
    Verb("sysid effects squirt", ()),
    Verb("sysid track pictures --camera camera.toml --fps 30 --palette palette.toml --out out",
         (*PICTURES, "pictures/times.csv", "camera.toml", "camera.toml", "palette.toml"), 3),
    Verb("sysid track film.avi --camera camera.toml --palette palette.toml --out out",
         ("film.avi", "film.avi", "camera.toml", "palette.toml"), 3),
    Verb("sysid doctor film.avi --table 1.881x0.943 --diameter 0.0615 --palette palette.toml --out out",
         ("film.avi", "film.avi", "palette.toml"), 2, draws=True),
    Verb("sysid calibrate pictures/0000.png --length 1.881 --width 0.943 --diameter 0.0615 --out out.toml",
         PICTURES[:1], 2, draws=True),
    Verb("planner scene pictures/0000.png --camera camera.toml --object red --out out.toml",
         (*PICTURES[:1], "camera.toml", "camera.toml"), 3),
    Verb("planner scene clips --clip 3 --cue cue --object red --out out.toml", CLIPS, 3),
    Verb("planner plan scene.toml --model model.toml --map map.toml --execution execution.toml --out out.json",
         ("scene.toml", "scene.toml", "model.toml", "map.toml", "execution.toml")),
    Verb("planner review plan.json --save out.rrd", ("plan.json",), 4),
    Verb("planner study --out study --scene 1 out.toml", ("study/scenes/0001.json",), 4),
    Verb("robot map campaign.csv --out out.toml", ("campaign.csv",), 4),
    Verb("robot review campaign.csv --map map.toml --save out.rrd", ("campaign.csv", "map.toml")),
    Verb("robot campaign campaign.csv --most 1", ("campaign.csv",), 4, ("campaign.csv",)),
    Verb("robot play plan.json --dry-run --settings launcher.toml", ("plan.json", "plan.json", "launcher.toml"), 6),
    Verb("robot play plan.json --settings launcher.toml --scene scene.toml --model model.toml --films out",
         ("plan.json", "scene.toml", "model.toml", "launcher.toml"), 1, ("plan.played.json",)),
    Verb("robot review learn --save out.rrd", SERIES, 4),
    Verb("robot learn --out learn --shots 2 --every 4 --repeats 3 --chosen 0",
         (*SERIES, "learn/emulated.json", "learn/start.toml", "learn/start_map.toml", *REFIT[1:]), 3, ("learn/",)),
    Verb("robot align --camera camera.toml --video film.avi --plan plan.json",
         ("camera.toml", "film.avi", "plan.json"), 2),
    Verb("robot calibrate --settings launcher.toml --strings 60 80 --repeats 2 --out out.toml", ("launcher.toml",), 3),
    Verb("robot repeat --settings launcher.toml --strings 60 --repeats 2", ("launcher.toml",)),
    Verb("robot status --port /dev/null --settings launcher.toml", ("launcher.toml",), 3),
)  # fmt: skip


def program_of(name: str) -> object:
    """The `main` of a command."""
    import planner.cli
    import robot.cli
    import sysid.cli

    mains: Mapping[str, object] = {"sysid": sysid.cli.main, "planner": planner.cli.main, "robot": robot.cli.main}
    return mains[name]
