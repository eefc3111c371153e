# Any target sets up .venv first; it is updated when pyproject.toml or constraints.txt change.

BIN := .venv/bin
READY := .venv/.ready
PYTHON ?=
PYTEST_ARGS ?=
FUZZ_ARGS ?= --seconds 600
TESTS = $(BIN)/python -m pytest --numprocesses auto --maxprocesses 4 --dist worksteal

unexport PYTHONDONTWRITEBYTECODE # without bytecode that is kept, collecting the tests takes twice the time

.DEFAULT_GOAL := help
.PHONY: help demo test test-slow test-thorough fuzz bench mutation study figures lint docs clean

help:
	@echo "make demo    the shipped example with a hidden effect, from start to end, into out/demo"
	@echo "make test    lint, then all tests except the slow ones (PYTEST_ARGS=\"-k name\" selects some)"
	@echo "make test-slow   the slow ones: whole discoveries, footage tracked from end to end"
	@echo "make test-thorough   sweeps: every verb on a full disk, kills of every long work, long sets (an hour)"
	@echo "make fuzz    changed inputs of every reader and verb for ten minutes (FUZZ_ARGS=\"--count 200000\")"
	@echo "make bench   speed, growth and accuracy figures (BENCH_ARGS=--note adds a row to docs/benchmarks.md)"
	@echo "make mutation    formulas broken one at a time: which faults the tests detect (an hour; resumable)"
	@echo "make study   how reliably hidden effects are found, into tests/study/REPORT.md (hours; resumable)"
	@echo "make figures the pages' measured figures, from the example, the reports and docs/figures.toml"
	@echo "make lint    ruff and mypy"
	@echo "make docs    the manual as a site, into out/docs"
	@echo "make clean   remove .venv, caches and out/demo"
	@echo
	@echo "PYTHON=/path/to/python chooses the Python (3.11, 3.12 or 3.13) that .venv is made from."

demo: $(READY)
	@$(BIN)/sysid demo --out out/demo --overwrite

test: lint
	@$(TESTS) -m "not slow" $(PYTEST_ARGS)

test-slow: $(READY)
	@$(TESTS) -m "slow and not thorough" $(PYTEST_ARGS)

test-thorough: $(READY)
	@$(TESTS) -m thorough $(PYTEST_ARGS)

fuzz: $(READY)
	@$(BIN)/python -m tests.fuzz $(FUZZ_ARGS)

bench: $(READY)
	@$(BIN)/python -m tests.bench $(BENCH_ARGS)

mutation: $(READY)
	@$(BIN)/python -m tests.mutation

study: $(READY)
	@$(BIN)/python -m tests.study

figures: demo
	@$(BIN)/python -m tests.figures --enter demo out/demo

lint: $(READY)
	@$(BIN)/python -m ruff check --quiet .
	@$(BIN)/python -m ruff format --check --quiet . || { echo "ruff format would change files: $(BIN)/ruff format ."; exit 1; }
	@$(BIN)/python -m mypy --no-error-summary

docs: $(READY)
	@$(BIN)/python -m pip install -qq --disable-pip-version-check --constraint constraints.txt --editable '.[docs]'
	@NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --quiet --strict
	@echo "open out/docs/index.html"

clean:
	@rm -rf .venv .pytest_cache .ruff_cache .mypy_cache .hypothesis dist out/demo
	@find . -name __pycache__ -type d -prune -exec rm -rf {} +

# .venv/.unfinished marks a set-up under way: one that was interrupted starts afresh. The stamp comes last.
define SETUP
fits='import sys; sys.exit(not (3, 11) <= sys.version_info[:2] < (3, 14))'
packed='import ensurepip, venv'
if [ -e .venv/.unfinished ] || ! .venv/bin/python -c "$$fits; import pip" 2>/dev/null; then
    rm -rf .venv
    python='' bare=''
    for candidate in $(if $(PYTHON),"$(PYTHON)",python3.13 python3.12 python3.11 python3); do
        "$$candidate" -c "$$fits" >/dev/null 2>&1 || continue
        bare="$$candidate"
        if "$$candidate" -c "$$packed" >/dev/null 2>&1; then python="$$candidate"; break; fi
    done
    if [ -z "$$python" ] && [ -n "$$bare" ]; then
        echo "$$bare cannot make a virtual environment: apt install python3-venv" >&2; exit 1
    elif [ -z "$$python" ]; then
        echo "no Python 3.11, 3.12 or 3.13$(if $(PYTHON), at $(PYTHON)): apt install python3 python3-venv," \
             "or make PYTHON=/path/to/python" >&2; exit 1
    fi
    echo "making .venv with $$("$$python" --version): a minute or two"
    mkdir .venv
    touch .venv/.unfinished
    "$$python" -m venv .venv || { rm -rf .venv; echo "no virtual environment: apt install python3-venv" >&2; exit 1; }
fi
touch .venv/.unfinished
pip() { .venv/bin/python -m pip install -qq --disable-pip-version-check --constraint constraints.txt "$$@"; }
pip --editable '.[dev]'
pip --no-deps dm-control # without its labmaze, which has no wheel from Python 3.13 on
.venv/bin/python -m sysid.prepare
rm .venv/.unfinished
touch $(READY)
endef
export SETUP

$(READY): pyproject.toml constraints.txt
	@sh -euc "$$SETUP"
