"""`python -m tests.figures`: fill the pages with docs/figures.toml, after entering what was measured.

Without options it enters what the reports in the repository say, and fills. `--enter SOURCE RESULT` reads the result of
that source's command first.
"""

from __future__ import annotations

import argparse
import datetime
import subprocess
import sys
from pathlib import Path

from models.errors import BadInput
from models.files import write_whole
from tests.figures.pages import DATA, ROOT, Sources, filled, pages, read_figures, write_figures
from tests.figures.sources import READERS, REPORTS, Figures


def parser() -> argparse.ArgumentParser:
    """The options."""
    p = argparse.ArgumentParser(prog="python -m tests.figures", description=(__doc__ or "").splitlines()[0])
    p.add_argument(
        "--enter", nargs=2, action="append", default=[], metavar=("SOURCE", "RESULT"),
        help=f"enter what a command measured: {', '.join(READERS)}, and the file or folder that it wrote",
    )  # fmt: skip
    return p


def entered(sources: Sources, name: str, figures: Figures) -> Sources:
    """With the figures of one source as they were measured now, of those that it has; the same where none changed."""
    old = sources[name]["figures"]
    if lacking := sorted(set(old) - set(figures)):
        raise BadInput(f"{name}: the result has no {', '.join(lacking)}; run the whole of: {sources[name]['command']}")
    new = {key: figures[key] for key in old}
    if new == old:
        return sources
    now = {"date": datetime.datetime.now(datetime.UTC).date(), "version": version()}
    return sources | {name: sources[name] | now | {"figures": new}}


def version() -> str:
    """The commit, short."""
    asked = ["git", "rev-parse", "--short", "HEAD"]
    return subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=False).stdout.strip() or "unknown"


def main() -> int:
    """0, or 2 for a result that cannot be read."""
    options, sources = parser().parse_args(), read_figures()
    results = dict(REPORTS) | {name: Path(result) for name, result in options.enter}
    for name, result in results.items():
        try:
            if name not in READERS:
                raise BadInput(f"{name} is read from no result; give one of {', '.join(READERS)}, or edit {DATA.name}")
            sources = entered(sources, name, READERS[name](result))
        except (BadInput, OSError, KeyError, ValueError) as error:
            print(f"{result}: {error}", file=sys.stderr)
            return 2
    write_figures(sources)
    for page in pages():
        text = page.read_text(encoding="utf-8")
        if (new := filled(text, sources)) != text:
            write_whole(page, new.encode())
            print(f"filled: {page.relative_to(ROOT)}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
