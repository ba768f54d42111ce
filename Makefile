# Two commands set up everything on a fresh machine: make demo, make test. Needs Python >= 3.11, nothing else.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
RUN := $(BIN)/python
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
UV := $(BIN)/uv --no-config --quiet pip
# uv takes a tenth of pip's time; pip goes on where uv cannot (an index that only pip's configuration names).
INSTALL = $(UV) install --python $(RUN) --require-hashes -r $(1) 2>/dev/null || $(PIP) install --no-compile --require-hashes -r $(1)
export PYTHONDONTWRITEBYTECODE ?=

.PHONY: web wheel demo test check torture bench lock clean help
help:
	@sed -n 's/^## //p' Makefile

$(VENV)/.created: requirements-setup.lock
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "daylit needs Python 3.11 or newer (make PYTHON=python3.12 ...)")'
	$(PYTHON) -m venv $(VENV)
	$(PIP) install --no-compile --require-hashes -r requirements-setup.lock || echo "no uv here: pip installs, at ten times the time"
	touch $@

$(VENV)/.core: requirements.lock pyproject.toml $(VENV)/.created
	$(call INSTALL,requirements.lock)
	$(PIP) install --no-deps --no-build-isolation -e .
	touch $@

$(VENV)/.dev: requirements-dev.lock $(VENV)/.core
	$(call INSTALL,requirements-dev.lock)
	touch $@

# What runs in browsers. Without its registry of libraries set-up goes on, and says what is missing.
$(VENV)/.web: studio/build.py $(shell find studio/web -path '*/node_modules' -prune -o -type f -print) $(VENV)/.core
	@$(RUN) -m studio.build && touch $@ || true

## make web       build the studio and the report's viewer (part of set-up)
web: $(VENV)/.web

## make wheel     build dist/daylit-*.whl, with pages and kernels built: an installed daylit compiles nothing on first use
wheel: $(VENV)/.core $(VENV)/.web
	$(PIP) wheel --no-deps --no-build-isolation --wheel-dir dist .

## make demo      set up, then the main job on simulated instruments: capture at full size, process, stage, report
demo: $(VENV)/.core $(VENV)/.web
	$(BIN)/daylit demo

# Byte code of all that tests import, once after an installation, which makes none: each worker would else compile it.
$(VENV)/.bytecode: $(VENV)/.dev
	@$(RUN) -m pytest --collect-only -qq >/dev/null 2>&1 || true
	@touch $@

## make test      set up, then run all tests but those that are marked for make torture
# Kernels first, once: workers that need the same ones at the same time would each compile them. Files stay whole, in
# their order: what a file's tests share (a demo, a profile of a rig, a room's light) is made by one worker.
test: $(VENV)/.bytecode $(VENV)/.web
	$(RUN) -c "from processing.ground.kernels import load_kernels; load_kernels()"
	$(RUN) -m pytest -n 2 --dist loadfile --no-loadscope-reorder

## make check     format, lint, types, layers
check: $(VENV)/.dev $(VENV)/.web
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(RUN) -m studio.build --types
	$(RUN) -m pytest -q tests/architecture

## make torture   the long fault-injection runs, all seeds, tests marked `long`, every benchmark on the smallest input; figures go to docs/measurements/reliability.md
torture: $(VENV)/.dev
	$(RUN) -m tests.torture
	DAYLIT_TORTURE=1 $(RUN) -m pytest -q -n 2 --dist loadfile --no-loadscope-reorder -m "sweep or long"
	DAYLIT_TORTURE=1 $(RUN) -m pytest -q tests/benchmarks/test_smoke.py

## make bench     every benchmark in full
bench: $(VENV)/.dev
	$(RUN) -m benchmarks all

## make lock      resolve pyproject.toml anew into the lock files
COMPILE := $(BIN)/uv pip compile --universal --generate-hashes --no-header --quiet
lock: $(VENV)/.created
	$(COMPILE) --group setup -o requirements-setup.lock
	$(COMPILE) pyproject.toml --extra build -o requirements.lock
	$(COMPILE) pyproject.toml --all-extras -c requirements.lock -o requirements-dev.lock

clean:
	rm -rf $(VENV) build dist *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis
