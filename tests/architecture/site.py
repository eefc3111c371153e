"""A hook of MkDocs: pages and pictures that lie beside the code they tell of join the site at their own paths.

Pages in docs/ link them as `../models/README.md`, which is right in the repository; in the site docs/ is the root.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
OUTSIDE_PAGES = (
    "CHANGELOG.md", "CONTRIBUTING.md", "models/README.md", "models/mjcf/launcher.md", "planner/STUDY.md",
    "robot/README.md", "tests/study/REPORT.md",
)  # fmt: skip
OUTSIDE_PICTURES = (
    "architecture.svg", "models/mjcf/launcher.png", "models/mjcf/table.png", "planner/STUDY.png", "planner/example.png",
    "robot/learn.png",
)  # fmt: skip


def on_files(files: Any, config: Any) -> Any:
    """Add what lies outside docs/."""
    from mkdocs.structure.files import File

    for name in OUTSIDE_PAGES + OUTSIDE_PICTURES:
        files.append(File.generated(config, name, abs_src_path=str(ROOT / name)))
    return files


def on_page_markdown(markdown: str, page: Any, config: Any, files: Any) -> str:
    """Links out of docs/ as the site has them."""
    return markdown if "/" in page.file.src_uri else re.sub(r"\]\(\.\./", "](", markdown)
