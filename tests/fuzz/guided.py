"""One reader under a fuzzer that follows what it covers: `python -m tests.fuzz.guided model -max_total_time=600`.

It needs `pip install atheris`, which nothing else here does. It begins with the reader's seeds; what it finds
interesting is kept in out/fuzz/corpus/READER, and a file that is read badly is written where it was started. Words
after the reader's name go to libFuzzer.
"""

from __future__ import annotations

import shutil
import sys
from pathlib import Path

try:
    import atheris
except ImportError:
    sys.exit("tests.fuzz.guided: needs atheris: .venv/bin/pip install atheris")

# Readers alone: numba could not compile what is instrumented.
WATCHED = (
    "models.files", "models.model_file", "planner.scene", "planner.planning", "planner.launcher.cueing_map",
    "planner.launcher.execution", "robot.cueing.campaign", "robot.device.protocol", "robot.device.settings",
    "robot.learning.history", "robot.order", "sysid.clips.header", "sysid.clips.read", "sysid.clips.rows",
    "sysid.estimation.solver.journal", "sysid.foreign", "sysid.new_effect", "sysid.vision.balls.colours.palette",
    "sysid.vision.camera.pictures.clicks",
)  # fmt: skip
with atheris.instrument_imports(include=list(WATCHED)):
    from tests.fuzz.readers import READERS, defect_of
    from tests.fuzz.verbs import SEEDS


def main(words: list[str]) -> None:
    """Fuzz the first seed of a reader until an option of libFuzzer ends it."""
    names = [reader.name for reader in READERS]
    if not words or words[0] not in names:
        sys.exit(f"tests.fuzz.guided: name one of {', '.join(names)}")
    reader = READERS[names.index(words[0])]
    place, corpus = Path("out/fuzz/guided"), Path("out/fuzz/corpus", reader.name.replace(" ", "_"))
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(SEEDS, place)
    corpus.mkdir(parents=True, exist_ok=True)
    for number, name in enumerate(reader.seeds):
        shutil.copyfile(SEEDS / name, corpus / f"seed{number}")

    def once(raw: bytes) -> None:
        (place / reader.seeds[0]).write_bytes(raw)
        if defect := defect_of(reader, place / reader.seeds[0]):
            raise RuntimeError(defect)

    atheris.Setup([sys.argv[0], *words[1:], str(corpus)], once)
    atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1:])
