"""The table as physics. Importing it chooses where compiled code is kept.

numba compiles again when a file changes, but not when a file changes that it calls into; then an old program would go
on running. So the folder's name holds what all compiled files say.
"""

import hashlib
import os
import sys
from pathlib import Path


def _choose_cache() -> None:
    here = Path(__file__).parent
    if os.environ.get("NUMBA_CACHE_DIR"):
        return
    sources = [path.read_bytes() for path in sorted(here.rglob("*.py"))]
    digest = hashlib.sha256(b"\0".join(text for text in sources if b"@njit" in text)).hexdigest()[:12]
    os.environ["NUMBA_CACHE_DIR"] = folder = str(here / "__pycache__" / f"numba-{digest}")
    if "numba" in sys.modules:
        sys.modules["numba"].config.CACHE_DIR = folder


_choose_cache()
