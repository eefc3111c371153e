"""The table as physics. Importing it chooses where compiled code is kept.

numba compiles again when a file changes, but not when one changes whose functions or constants it uses; then an old
program would go on running. So the folder's name holds what all compiled files say, and those that they import.
"""

import hashlib
import os
import re
import sys
from pathlib import Path


def _choose_cache() -> None:
    here = Path(__file__).parent
    if os.environ.get("NUMBA_CACHE_DIR"):
        return
    sources = {path.relative_to(here): path.read_bytes() for path in sorted(here.rglob("*.py"))}
    compiled = {path for path, text in sources.items() if b"\n@njit" in text}
    used = {m for path in compiled for m in re.findall(rb"^from models\.([\w.]+) import", sources[path], re.MULTILINE)}
    compiled |= {Path(*name.decode().split(".")).with_suffix(".py") for name in used}
    said = b"\0".join(sources[path] for path in sorted(compiled & sources.keys()))
    folder = here / "__pycache__" / f"numba-{hashlib.sha256(said).hexdigest()[:12]}"
    os.environ["NUMBA_CACHE_DIR"] = str(folder)
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = str(folder)


_choose_cache()
