"""Command lines that write, on the inputs of tests/fuzz: a line for each writing verb and each kind of file.

What they write goes below `out`, but for verbs that continue or add to what is there; `{films}` is a folder that
`film` has filled.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]

SIZES = "--table 3.569x1.778 --diameter 0.0525"
SMALL = "--table 1.881x0.943 --diameter 0.0615 --no-pockets"
NOTED = ("robot play",)  # a stroke has been made: what of it could not be kept is noted, with status 1
WORKS = {
    "sysid check": "sysid check clips --json out/a.json",
    "sysid compare": "sysid compare clips --model model.toml --json out/a.json --report out/a.html --rrd out/a.rrd",
    "sysid fit": "sysid fit clips --out out/a.toml --json out/a.json --report out/a.html --rrd out/a.rrd",
    "sysid measure": "sysid measure clips --out out/a.toml --json out/a.json --report out/a.png",
    "sysid diagnose": "sysid diagnose clips --json out/a.json --report out/a.html",
    "sysid discover": "sysid discover clips --out out/found --json out/a.json",
    "sysid demo": "sysid demo --out out/demo",
    "sysid plot": "sysid plot clips --out out/a.png",
    "sysid import": f"sysid import track.csv {SIZES} --unit m --origin centre --x-along length --fps 60 "
    "--out out/clips",
    "sysid review": "sysid review clips --save out/a.rrd",
    "sysid add": "sysid add squirt --model model.toml --out out/a.toml",
    "sysid remove": "sysid remove slide_friction_speed --model learn/fits/0002/model.toml --out out/a.toml",
    "sysid export": "sysid export native.toml --out out/a.xml",
    "sysid init": "sysid init out/clips --table snooker",
    "sysid markers": "sysid markers --table snooker --out out/a.pdf",
    "sysid new-effect": "sysid new-effect mine --from result.json --dir out/effects",
    "sysid effects": "sysid effects --json out/a.json",
    "sysid match": "sysid match --clips out/clips",
    "sysid track": "sysid track {films}/one.mp4 --camera {films}/camera.toml --out out/clips --sheet out/a.png "
    "--preview out/pictures --rrd out/a.rrd --json out/a.json",
    "sysid doctor": f"sysid doctor {{films}}/one.mp4 {SMALL} --out out/all",
    "sysid calibrate": f"sysid calibrate {{films}}/one.mp4 {SMALL} --out out/a.toml --report out/a.png "
    "--json out/a.json",
    "planner scene": "planner scene clips --clip 3 --cue cue --object red --out out/a.toml",
    "planner plan": "planner plan scene.toml --model model.toml --map map.toml --out out/a.json --report out/a.html "
    "--picture out/a.png --rrd out/a.rrd",
    "planner review": "planner review plan.json --save out/a.rrd",
    "planner view": "planner view --frames 2 --out out/pictures",
    "planner study": "planner study --out out/study --scenes 2 --jobs 1 --method risk --report out/a.md "
    "--json out/a.json",
    "planner study --scene": "planner study --out study --scene 1 out/a.toml",
    "robot map": "robot map campaign.csv --out out/a.toml --report out/a.html --picture out/a.png",
    "robot review": "robot review learn --save out/a.rrd",
    "robot review CSV": "robot review campaign.csv --map map.toml --save out/a.rrd",
    "robot campaign": "robot campaign out/a.csv --most 3",
    "robot play": "robot play plan.json --settings launcher.toml --scene scene.toml --clips out/clips",
    "robot learn": "robot learn --out out/series --shots 1 --every 4 --repeats 3 --json out/a.json",
    "robot calibrate": "robot calibrate --settings launcher.toml --strings 60 80 --repeats 2 --out out/a.toml "
    "--json out/a.json --log out/a.jsonl",
    "robot repeat": "robot repeat --settings launcher.toml --strings 60 --repeats 2 --json out/a.json",
}


def film(folder: Path) -> None:
    """One film of a short shot, one.mp4, and its camera."""
    folder.mkdir()
    sizes = ["--length", "1.881", "--width", "0.943", "--diameter", "0.0615", "--no-pockets"]
    shot = ["--clips", "3", "--seconds", "0.8", "--fps", "60", "--kind", "roll", "--seed", "0"]
    for words in (
        ["tests.truth", "one", *shot, *sizes],
        ["tests.footage", "one", "one.mp4"],
        ["sysid.cli", "calibrate", "one.mp4", *sizes, "--out", "camera.toml"],
    ):
        done = subprocess.run(
            [sys.executable, "-m", *words], cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)},
            capture_output=True, check=False,
        )  # fmt: skip
        if done.returncode not in (0, 1):  # 1: a camera that is not to be trusted, of few frames
            raise RuntimeError(done.stderr.decode())
