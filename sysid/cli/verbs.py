"""The `sysid` command: every verb reads its input, prints a table, and writes the same figures on request."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from models.commands.program import Program, run
from sysid.cli import doctor, effects, export, match, review
from sysid.cli.clips import calibrate, foreign, init, markers, track
from sysid.cli.identification import compare, discovery, measure, plot

PROGRAM = Program(
    "sysid",
    "Identify a snooker table: fit a MuJoCo model to filmed or tracked shots, and find what it leaves out.",
    {
        "Clips of a table": (
            markers.markers,
            calibrate.calibrate,
            track.track,
            foreign.import_,
            init.init,
            compare.check,
            doctor.doctor,
        ),
        "Model from clips": (measure.measure, compare.compare, compare.fit, plot.plot),
        "What the model leaves out": (discovery.diagnose, discovery.discover, discovery.demo, review.review),
        "Effects of the model": (effects.effects, effects.add, effects.remove, effects.new_effect),
        "The table for others": (export.export,),
        "The engines themselves": (match.match,),
    },
)


def main(words: Sequence[str] | None = None) -> int:
    """Run a verb: 0 done, 1 a finding to act on, 2 bad input."""
    return run(PROGRAM, words, interrupted="; files named above are complete")


if __name__ == "__main__":
    sys.exit(main())
