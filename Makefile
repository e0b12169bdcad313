# Everything a stranger needs: `make demo` shows a report, `make test` proves the code.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALL := $(shell command -v uv >/dev/null 2>&1 && echo "uv pip install --quiet --compile-bytecode --python $(BIN)/python" || echo "$(BIN)/python -m pip install --quiet --disable-pip-version-check")
CORES := $(shell $(PYTHON) -c "import os; print(len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count())")

.PHONY: demo test test-all lint benchmarks clean

demo: $(VENV)/installed
	$(BIN)/attlog analyze sample_logs/copter_yaw_turns.bin -o reports

test: $(VENV)/installed-test
	$(BIN)/python -m pytest -n $(CORES) -m "not slow"

test-all: $(VENV)/installed-test
	$(BIN)/python -m pytest -n $(CORES)

lint: $(VENV)/installed-test
	$(BIN)/ruff check attlog tests benchmarks

benchmarks: $(VENV)/installed-test
	for script in benchmarks/*.py; do $(BIN)/python $$script || exit 1; done

$(VENV)/bin/python:
	$(PYTHON) -m venv $(VENV)

$(VENV)/installed: pyproject.toml $(VENV)/bin/python
	$(INSTALL) -e .
	touch $@

$(VENV)/installed-test: pyproject.toml $(VENV)/bin/python
	$(INSTALL) -e ".[test]"
	touch $@ $(VENV)/installed

clean:
	rm -rf $(VENV) build dist
