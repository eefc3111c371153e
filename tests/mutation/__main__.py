"""Break formulas one at a time, run the tests, and list what no test noticed: `python -m tests.mutation`.

Each mutant lives in a copy of the checkout. A compiled formula first meets its tests as plain Python, which takes
seconds; a mutant that survives is compiled, and meets the tests that name its file, then all others of `models/`
(--stages 1), then all that `make test` runs (--stages 2). Results are kept as they come (results.jsonl); the same
command goes on where it was interrupted, and --again tries once more what had survived. What is broken, and what is
left out and why: mutants.py; mutants that change nothing that can be seen: equivalents.py.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from tests.mutation.equivalents import EQUIVALENTS
from tests.mutation.mutants import Mutant, sample
from tests.mutation.workshop import COPIED, ROOT, STAGE_LIMIT_S, Workshop, is_compiled

SCORE_WANTED = 0.9


def digest() -> str:
    """Of all that is copied."""
    found = hashlib.sha256()
    for path in sorted(path for name in COPIED for path in (ROOT / name).rglob("*.py")):
        found.update(str(path).encode() + b"\0" + path.read_bytes())
    return found.hexdigest()


def prepared(out: Path) -> Workshop:
    """A compiled copy in which nothing is broken."""
    note = out / "unbroken.json"
    known = json.loads(note.read_text()) if note.exists() else {}
    if known.get("digest") == digest():
        return Workshop(out / "unbroken", tuple(known["skipped"]))
    print("compiling, and which tests need compiled code", flush=True)
    shop = Workshop(out / "unbroken")
    shop.fill(ROOT)
    if not shop.imports_itself():
        raise SystemExit(f"{shop.folder}: Python imports another checkout; is it installed in front of PYTHONPATH?")
    shop.run(["-m", "sysid.prepare"], STAGE_LIMIT_S)
    shop = Workshop(shop.folder, shop.unfit_as_plain_python())
    note.write_text(json.dumps({"digest": digest(), "skipped": shop.skipped}))
    return shop


def prove(shop: Workshop, judged: list[dict[str, str]]) -> None:
    """See that the tests that caught something pass where nothing is broken."""
    tests = sorted({one["test"] for one in judged if one["caught"] and "::" in one["test"]} - set(shop.skipped))
    if tests:
        status, text = shop.pytest(tests, STAGE_LIMIT_S)
        if status:
            raise SystemExit(f"tests that caught mutants fail before anything is broken:\n{text[-2000:]}")


def report(judged: list[dict[str, str]]) -> float:
    """Print the score and what survived; the score."""
    counted = [one for one in judged if one["mutant"] not in EQUIVALENTS]
    caught = sum(bool(one["caught"]) for one in counted)
    score = caught / max(len(counted), 1)
    print(f"\n{caught} of {len(counted)} caught: {100 * score:.0f} %, and {len(judged) - len(counted)} equivalent")
    for one in counted:
        if not one["caught"]:
            print(f"survived: {one['mutant']}")
    return score


def main() -> int:
    """Run, and print the score and the mutants that no test noticed."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutation", description=main.__doc__, allow_abbrev=False)
    parser.add_argument("--count", type=int, default=80, help="mutants (default: %(default)s)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=2, help="side by side (default: %(default)s)")
    parser.add_argument("--stages", type=int, default=2, choices=(1, 2), help="1: tests of models/; 2: all tests")
    parser.add_argument("--again", action="store_true", help="try once more what had survived")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "mutation", help="results and copies")
    args = parser.parse_args()
    args.out = args.out.resolve()
    args.out.mkdir(parents=True, exist_ok=True)
    results = args.out / "results.jsonl"
    lines = results.read_text().splitlines() if results.exists() else []
    known = {one["mutant"]: one for one in map(json.loads, lines)}  # the last word counts
    wanted = sample(ROOT, args.count, args.seed)
    todo = [one for one in wanted if one.name not in EQUIVALENTS]
    todo = [one for one in todo if one.name not in known or (args.again and not known[one.name]["caught"])]
    todo.sort(key=lambda one: is_compiled(one.file))  # the quick ones first
    lock = threading.Lock()
    free: list[Workshop] = []
    if todo:
        unbroken = prepared(args.out)
        free = [Workshop(args.out / f"copy{k}", unbroken.skipped) for k in range(args.jobs)]
        for shop in free:
            shop.fill(unbroken.folder)

    def run(mutant: Mutant) -> None:
        with lock:
            shop = free.pop()
        began = time.monotonic()
        stage, test = shop.try_out(mutant, args.stages)
        with lock:
            free.append(shop)
            known[mutant.name] = {"mutant": mutant.name, "caught": stage, "test": test}
            with results.open("a") as file:
                file.write(json.dumps(known[mutant.name]) + "\n")
            print(f"{time.monotonic() - began:5.0f} s  {stage or 'SURVIVED':9s} {mutant.name[:150]}", flush=True)

    with ThreadPoolExecutor(args.jobs) as pool:
        list(pool.map(run, todo))
    judged = [known.get(one.name, {"mutant": one.name, "caught": ""}) for one in wanted]
    if todo:
        prove(unbroken, judged)
    return 0 if report(judged) >= SCORE_WANTED else 1


if __name__ == "__main__":
    sys.exit(main())
