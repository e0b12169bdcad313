# Everything a stranger needs: `make demo` shows a report, `make test` proves the code, `make check` is what CI asks first.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
CORES := $(shell $(PYTHON) -c "import os; print(len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count())")
# $(call install,WHAT): uv where it is on PATH and works, else pip.
install = (command -v uv >/dev/null 2>&1 && uv pip install --quiet --compile-bytecode --python $(BIN)/python -e $(1)) \
	|| $(BIN)/python -m pip install --quiet --disable-pip-version-check -e $(1)

.PHONY: demo test test-all test-rights fuzz check format docs bench bench-page bench-guard clean

demo: $(VENV)/installed
	$(BIN)/attlog analyze sample_logs/copter_yaw_turns.bin -o reports

test: $(VENV)/installed-test
	$(BIN)/python -m pytest -n $(CORES) -m "not slow"

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

# Every aim about speed and memory against its peer, with verdict: minutes. bench-page also writes docs/speed.md.
bench: $(VENV)/installed-test
	$(BIN)/python benchmarks/bench.py

bench-page: $(VENV)/installed-test
	$(BIN)/python benchmarks/bench.py --page docs/speed.md

# Fails where a ratio to a peer got worse than committed; no test, holds on a busy machine.
bench-guard: $(VENV)/installed-test
	$(BIN)/python benchmarks/guard.py

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: pyproject.toml $(VENV)/bin/python
	$(call install,.)
	$(BIN)/python -m compileall -q attlog
	touch $@

$(VENV)/installed-test: pyproject.toml $(VENV)/bin/python
	$(call install,".[test]")
	touch $@ $(VENV)/installed

$(VENV)/installed-check: pyproject.toml $(VENV)/bin/python
	$(call install,".[check]")
	touch $@ $(VENV)/installed-test $(VENV)/installed

clean:
	rm -rf $(VENV) build dist site
