"""The README and the manual: links, anchors and pictures exist, command lines name what there is, Python blocks run."""

from __future__ import annotations

import ast
import functools
import importlib
import importlib.util
import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import click
import pytest

import sysid
from tests.architecture.reference import PAGES as WRITTEN_PAGES
from tests.architecture.site import OUTSIDE_PAGES, OUTSIDE_PICTURES
from tests.architecture.source import ROOT

PAGES = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").glob("*.md")])
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]
PROGRAMS = {name: importlib.import_module(f"{name}.cli.verbs").PROGRAM for name in ("sysid", "planner", "robot")}
MAX_README_WORDS = 700
SHELL_ENDS = {"&&", "|", ";", ">"}
ARGPARSE_OPTION = re.compile(r"(--?[a-z][a-z-]*)")


def without_code(text: str) -> str:
    """The text without code blocks and inline code."""
    return re.sub(r"`[^`\n]*`", "", re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE))


@functools.cache
def anchors(page: Path) -> frozenset[str]:
    """The anchors of a page's headings, as GitHub and MkDocs make them."""
    found, fenced = set(), re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)
    for title in re.findall(r"^#+ (.+)$", fenced, re.MULTILINE):
        plain = re.sub(r"[^\w\s-]", "", title.strip().lower())
        found.add(re.sub(r"\s", "-", plain))
    return frozenset(found)


def broken_links(page: Path) -> Iterator[str]:
    """Relative links of a page that lead nowhere."""
    for link in re.findall(r"\]\(([^)\s]+)\)", without_code(page.read_text(encoding="utf-8"))):
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        if not target.is_file():
            yield f"{link}: no such file"
        elif anchor and anchor not in anchors(target):
            yield f"{link}: no such heading; {target.name} has {', '.join(sorted(anchors(target)))}"


def command_lines(text: str) -> Iterator[list[str]]:
    """Words of every command line in code: blocks without a language, and inline code."""
    blocks = re.findall(r"^```\n(.*?)^```", text, re.DOTALL | re.MULTILINE)
    indented = re.findall(
        r"^    (?=\S)(.*)$", re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE), re.MULTILINE
    )
    prose = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    inline = [" ".join(code.split()) for code in re.findall(r"`([^`]+)`", prose)]
    for block in [*blocks, *indented, *inline]:
        for line in block.replace("\\\n", " ").splitlines():
            yield from split_commands(line)


def split_commands(line: str) -> Iterator[list[str]]:
    """The commands of one line, without comments, `.venv/bin/` and assignments in front."""
    try:
        words = shlex.split(line, comments=True)
    except ValueError:  # an apostrophe: prose
        return
    command: list[str] = []
    for word in [*words, ";"]:
        if word in SHELL_ENDS:
            while command and re.fullmatch(r"[A-Z_]+=.*", command[0]):
                del command[0]
            if command:
                yield [command[0].removeprefix(".venv/bin/"), *command[1:]]
            command = []
        else:
            command.append(word)


def fault(words: list[str]) -> str:
    """What is wrong with a command line; empty where nothing is, or where it is none of ours."""
    program, *rest = words
    if program == "make":
        targets = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
        wrong = [w for w in rest if re.fullmatch(r"[a-z-]+", w) and w not in targets]
        return f"no target {wrong[0]}" if wrong else ""
    if program in ("python", "python3") and rest[:1] == ["-m"] and len(rest) > 1:
        return module_fault(rest[1], rest[2:])
    if program not in PROGRAMS or not rest:
        return ""
    verb = PROGRAMS[program].commands.get(rest[0])
    return options_fault(verb, rest[1:]) if verb else f"no verb {rest[0]}"


def options_fault(command: click.Command, words: list[str]) -> str:
    """The first option that a command does not have."""
    known = {name for param in command.params for name in (*param.opts, *param.secondary_opts)} | {"--help", "-h"}
    wrong = [word.split("=")[0] for word in words if re.match(r"--?[a-z]", word)]
    wrong = [word for word in wrong if word.rstrip("].,") not in known]
    return f"{command.name} has no option {wrong[0]}" if wrong else ""


def module_fault(name: str, words: list[str]) -> str:
    """A module that is not there, or an option that its source does not declare."""
    if name.split(".")[0] not in ("models", "sysid", "planner", "robot", "tests"):
        return ""
    spec = importlib.util.find_spec(name)
    if spec is None:
        return f"no module {name}"
    folder = Path(spec.submodule_search_locations[0]) if spec.submodule_search_locations else None
    source = folder / "__main__.py" if folder else Path(str(spec.origin))
    if not source.is_file():
        return f"{name} is not run as a module"
    if name.endswith(".cli"):
        return fault([name.split(".")[0], *words])
    parser = getattr(importlib.import_module(f"{name}.__main__" if folder else name), "parser", None)
    known = set(parser()._option_string_actions) if parser else declared(source.read_text(encoding="utf-8"))
    known |= {"--help", "-h"}
    wrong = [w.split("=")[0].rstrip("].,") for w in words if re.match(r"\[?--?[a-z]", w)]
    wrong = [w.lstrip("[") for w in wrong if w.lstrip("[") not in known]
    return f"{name} has no option {wrong[0]}" if wrong else ""


def declared(source: str) -> set[str]:
    """Options among the string constants of a source, and those that models.commands declares for it."""
    tree = ast.walk(ast.parse(source))
    found: set[str] = set()
    for node in tree:
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and ARGPARSE_OPTION.fullmatch(node.value):
            found.add(node.value)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.args:
            first = node.args[0]
            if node.func.id in ("input_option", "output_option") and isinstance(first, ast.Constant):
                found.add(f"--{first.value}")
            elif node.func.id == "out_option":
                found.add("--out")
    return found


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_links_lead_somewhere(page: Path) -> None:
    assert not list(broken_links(page))


@pytest.mark.parametrize("page", PAGES, ids=NAMES)
def test_commands_exist_with_their_options(page: Path) -> None:
    faults = [f"{' '.join(w)}: {fault(w)}" for w in command_lines(page.read_text(encoding="utf-8")) if fault(w)]
    assert not faults


@pytest.mark.parametrize(
    ("line", "told"),
    [
        (".venv/bin/sysid discovr CLIPS", "no verb discovr"),
        ("mkdir -p out && sysid fit CLIPS --owt M.toml", "fit has no option --owt"),
        ("make demonstration", "no target demonstration"),
        ("python -m tests.trouth out", "no module tests.trouth"),
        ("python -m tests.truth out --sead 3", "tests.truth has no option --sead"),
        ("python -m models.mjcf.render OUT.png --widht 3", "models.mjcf.render has no option --widht"),
        ("PYTHON=x make test # --anything", ""),
        ("sysid fit CLIPS --out M.toml | head", ""),
    ],
)
def test_wrong_commands_are_seen(line: str, told: str) -> None:
    assert "; ".join(filter(None, map(fault, split_commands(line)))) == told


def test_all_command_lines_are_looked_at() -> None:
    named = {(w[0], w[1]) for page in PAGES for w in command_lines(page.read_text(encoding="utf-8")) if len(w) > 1}
    missing = {(p, verb) for p, program in PROGRAMS.items() for verb in program.commands} - named
    assert not missing, "verbs that no page tells of"


def test_what_a_change_must_pass_is_told() -> None:
    """`.ci/run` does nothing that the README does not name."""
    told = {" ".join(w[:2]) for w in command_lines((ROOT / "README.md").read_text(encoding="utf-8")) if w[0] == "make"}
    script = (ROOT / ".ci/run").read_text(encoding="utf-8")
    lines = [line for line in script.splitlines() if line and not re.match(r"#|set -|cd ", line)]
    assert lines and {line.removeprefix("exec ") for line in lines} <= told


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").split()) <= MAX_README_WORDS


def test_every_page_is_reached() -> None:
    """From the README over the table of pages, and in the site's navigation, with all that lies beside the code."""
    index = (ROOT / "docs/index.md").read_text(encoding="utf-8")
    site = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    for page in (ROOT / "docs").glob("*.md"):
        assert page.name == "index.md" or f"]({page.name})" in index, page.name
        assert re.search(rf"[ -]{page.name}$", site, re.MULTILINE), page.name
    for name in (*OUTSIDE_PAGES, *OUTSIDE_PICTURES):
        assert (ROOT / name).is_file(), name
    linked = {
        t for p in PAGES for t in re.findall(r"\]\(\.\./([\w./]+\.(?:md|png|svg))", p.read_text(encoding="utf-8"))
    }
    assert linked <= {*OUTSIDE_PAGES, *OUTSIDE_PICTURES}


def test_tools_of_the_manual_are_pinned() -> None:
    asked = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["optional-dependencies"]
    pinned = {line.split("==")[0] for line in (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()}
    assert {re.split(r"[\[<>=]", need, maxsplit=1)[0] for need in asked["docs"]} <= pinned


@pytest.mark.slow
def test_the_python_of_the_pages_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    names: dict[str, Any] = {}
    for block in re.findall(r"^```python\n(.*?)^```", (ROOT / "docs/python.md").read_text(), re.DOTALL | re.MULTILINE):
        exec(block, names)
    assert names["found"].verdict == ("table_tilt",)
    headline, *said = str(names["found"]).splitlines()
    assert headline.startswith("A table that is not level (certain)")
    assert [line.split(":")[0] for line in said] == ["missing", "size", "certainty", "next"]
    slope, (before, after) = (
        re.findall(r"table_tilt \(slope_x (\S+)", said[0])[0],
        re.findall(r"([\d.]+) mm", said[1])[:2],
    )
    assert float(slope) == pytest.approx(0.0007, abs=5e-5), "what the example hides"
    assert float(after) < 0.4 * float(before)
    assert "table_tilt.slope_x" in names["found"].model.estimates
    assert names["made"]["stroke"] is not None
    diagnosis = sysid.diagnose(names["clips"])
    assert diagnosis.verdict == diagnosis.ranking[0][0] == "table_tilt"


@pytest.mark.parametrize("page", WRITTEN_PAGES)
def test_reference_and_catalogue_are_those_of_the_docstrings(page: str) -> None:
    assert (ROOT / page).read_text(encoding="utf-8") == WRITTEN_PAGES[page](), "python -m tests.architecture.reference"
