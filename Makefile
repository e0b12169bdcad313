# Everything a stranger needs: `make demo` shows a report, `make test` proves the code, `make check` is what CI asks first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
CORES := $(shell $(PYTHON) -c "import os; print(len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count())")
# $(call install,WHAT): uv where it is on PATH and works, else pip. Both are silent, so they compile nothing: neither all
# of Python's files (20 s; each is compiled when it is first imported) nor kernels, which $(compile) counts.
install = (command -v uv >/dev/null 2>&1 && ATTLOG_KERNELS=none uv pip install --quiet --python $(BIN)/python -e $(1)) \
	|| ATTLOG_KERNELS=none $(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile -e $(1)
# $(call ticking,COMMAND): with a dot every five seconds, for what says nothing itself; the dots end with the shell.
ticking = { while sleep 5 >/dev/null 2>&1 && kill -0 $$$$ 2>/dev/null; do printf .; done & } ; dots=$$!; ( $(1) ); code=$$?; kill $$dots; echo; exit $$code
compile = $(BIN)/python -m attlog.core.jit.build --here

# Bytecode is kept also where the environment says not to: else each of the tests' processes compiles all of Python's
# files that it imports, and every worker the tests themselves.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: demo test test-slowest test-all test-rights fuzz check format docs example bench bench-page clean

demo: $(VENV)/installed
	@echo "analysing a flight with 8 filters, a few seconds"
	$(BIN)/attlog analyze sample_logs/copter_yaw_turns.bin -o reports

test: $(VENV)/installed-test
	$(BIN)/python -m pytest -n $(CORES) --dist worksteal -m "not slow"

# Where the time of `make test` goes. What takes more than half a second there belongs to test-all (marked slow),
# or into a smaller case: few() in tests/conftest.py keeps the first cases of a parametrisation.
test-slowest: $(VENV)/installed-test
	$(BIN)/python -m pytest -n $(CORES) --dist worksteal -m "not slow" --durations 60 --durations-min 0.3

test-all: $(VENV)/installed-test
	$(BIN)/python -m pytest -n $(CORES) --durations 25

# What depends on file permissions, as a user who has no special rights (root would skip it).
test-rights: $(VENV)/installed-test
	ATTLOG_REQUIRE_RIGHTS=1 $(BIN)/python -m pytest -m rights -p no:cacheprovider

# Broken logs through every command for so many seconds; ATTLOG_CORPUS names a folder with more logs to break.
SECONDS ?= 600
fuzz: $(VENV)/installed-test
	$(BIN)/python -m tests.fuzz.campaign --seconds $(SECONDS)

check: $(VENV)/installed-check
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/mkdocs build --strict --quiet --site-dir $(VENV)/site

format: $(VENV)/installed-check
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

docs: $(VENV)/installed-check
	$(BIN)/mkdocs build --strict --site-dir site

# The report and the picture that README and docs show, of this version.
example: $(VENV)/installed-check
	$(BIN)/attlog -q analyze sample_logs/copter_yaw_turns.bin -o reports
	cp reports/copter_yaw_turns.bin.html reports/example.html
	$(BIN)/python docs/picture.py reports/example.html

# Every aim about speed and memory against its peer, with verdict: minutes. bench-page also writes docs/speed.md.
bench: $(VENV)/installed-test
	$(BIN)/python benchmarks/bench.py

bench-page: $(VENV)/installed-test
	$(BIN)/python benchmarks/bench.py --page docs/speed.md

$(VENV)/bin/python:
	@$(PYTHON) -c "import sys; sys.version_info >= (3, 11) or sys.exit('attlog needs Python 3.11 or newer, this is %d.%d: make $(or $(firstword $(MAKECMDGOALS)),demo) PYTHON=python3.12' % sys.version_info[:2])"
	@echo "making an environment in $(VENV), ten seconds"
	@$(PYTHON) -m venv $(VENV)

# Tests run every filter: theirs are compiled at once, those of the demo's log alone take a third of the time.
$(VENV)/installed: pyproject.toml $(VENV)/bin/python
	@echo "installing attlog with numba, numpy, pandas, plotly, pymavlink and their like (450 MB), half a minute to two"
	@$(call ticking,$(call install,.))
	@$(compile) --rows default,ap_ekf3
	@touch $@

$(VENV)/installed-test: pyproject.toml $(VENV)/bin/python
	@echo "installing attlog and what its tests need (1.2 GB), two minutes"
	@$(call ticking,$(call install,".[test]"))
	@$(compile) --all
	@touch $@ $(VENV)/installed

$(VENV)/installed-check: pyproject.toml $(VENV)/bin/python
	@echo "installing attlog and what its tests, checks and docs need (1.4 GB), two minutes"
	@$(call ticking,$(call install,".[check]"))
	@$(compile) --all
	@touch $@ $(VENV)/installed-test $(VENV)/installed

clean:
	rm -rf $(VENV) build dist site
