"""Whether a file is whole, by the kind that its name tells."""

from __future__ import annotations

import ast
import json
import re
import tomllib
from pathlib import Path

import cv2
import numpy as np

PNG_END = b"IEND\xaeB`\x82"


def broken(path: Path) -> str:
    """What is wrong with a file; "" for a whole one."""
    content, kind = path.read_bytes(), path.suffix
    try:
        if kind == ".json":
            json.loads(content)
        elif kind == ".jsonl":
            _ = [json.loads(line) for line in _lines(content)]
        elif kind == ".toml":
            tomllib.loads(content.decode())
        elif kind == ".py":
            ast.parse(content)
        elif kind == ".csv":
            lines = _lines(content)
            if len({line.count(",") for line in lines if '"' not in line}) > 1:
                return "rows of different lengths"
        elif kind == ".rrd":
            from rerun.chunk import RrdReader

            RrdReader(path).store()
        elif kind == ".png":
            seen = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
            if seen is None or not content.endswith(PNG_END):
                return "no whole picture"
        elif kind == ".html":
            return "" if content.rstrip().endswith(b"</html>") else "no end"
        elif kind == ".pdf":  # comments may follow its end
            return "" if re.search(rb"%%EOF\s+(% .*\n)*\Z", content) else "no end"
        elif kind in (".md", ".txt"):
            return "" if content.endswith(b"\n") else "no end"
        else:
            return "of unknown kind"
    except (ValueError, SyntaxError, OSError, RuntimeError) as error:
        return " ".join(str(error).split())[:120] or type(error).__name__
    return ""


def _lines(content: bytes) -> list[str]:
    """Whole lines; ValueError where the last has no end."""
    if content and not content.endswith(b"\n"):
        raise ValueError("a line without an end")
    return content.decode().splitlines()
