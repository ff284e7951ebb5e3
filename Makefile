# `make help` lists the targets. Each one sets up what it needs (tools/setup.sh); the second call finds it done.
BIN := .venv/bin
INSTALLED := .venv/.installed
OPENGL := .venv/.opengl

WORKERS ?= 2
PYTEST := $(BIN)/python -m pytest -n $(WORKERS)
# ISOSAMPLE_VOLUMES: folder of real scans (default ../shared/volumes); without it their tests are skipped.
# 1: a test that needs OpenGL fails without it; 0: it is skipped.
export ISOSAMPLE_REQUIRE_GL ?= 1
ifneq ($(ISOSAMPLE_REQUIRE_GL),0)
TEST_OPENGL := $(OPENGL)
endif

.PHONY: help demo test test-all lint format bench lock clean distclean

help:  ## list the targets
	@sed -n 's/^\([a-z-]*\):.*## /\1\t/p' $(MAKEFILE_LIST) | expand -t 12

demo: $(OPENGL)  ## render built-in volumes through the whole pipeline; pictures in demo/
	$(BIN)/isosample demo -o demo

test: lint $(TEST_OPENGL)  ## lint, then every test that is quick
	$(PYTEST) -m "not slow"

test-all: lint $(TEST_OPENGL)  ## lint, then every test
	$(PYTEST)

lint: $(INSTALLED)  ## style, types, layers, spelling
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo
	$(BIN)/codespell

format: $(INSTALLED)  ## let ruff rewrite the sources in the house style
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

bench: $(OPENGL)  ## run the programs that measure, one after the other
	$(BIN)/python -m benchmarks

lock:  ## write requirements.lock anew (UPGRADE=1: newest versions)
	tools/setup.sh lock

clean:  ## remove what the targets made, but for .venv and the cache of meshes
	rm -rf demo build dist test_artifacts .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
	find . -path ./.venv -prune -o -type d -name __pycache__ -prune -exec rm -rf {} +

distclean: clean  ## clean, and remove .venv
	rm -rf .venv

$(INSTALLED): requirements.lock pyproject.toml tools/setup.sh
	tools/setup.sh python
	touch $@

$(OPENGL): $(INSTALLED)
	tools/setup.sh opengl
	touch $@
