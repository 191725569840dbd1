# Every target does its own set-up: only python3 (3.11 to 3.13) with pip, and make, are needed.

PYTHON ?= python3
BIN := .venv/bin

# Some hundred processes start in the tests: each would compile every module it imports again where a setting forbids to
# keep them (1.8 of 3 seconds of a start).
unexport PYTHONDONTWRITEBYTECODE
# Pictures are written to files, on machines without a screen as well.
export MPLBACKEND := Agg
# The build tool is pinned like everything else (the first name is read by older pips, the second by newer ones).
export PIP_CONSTRAINT := constraints.txt
export PIP_BUILD_CONSTRAINT := constraints.txt
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.DEFAULT_GOAL := help
.PHONY: help demo docs test units lint types imports kernels bench audit clean

help: ## this list
	@sed -n 's/^\([a-z]*\):.*## \(.*\)/make \1|\2/p' $(MAKEFILE_LIST) | while IFS='|' read -r name text; do \
		printf '  %-14s %s\n' "$$name" "$$text"; done

demo: kernels ## walk an investor through 27 years of real returns, into demo/
	$(BIN)/inscrutable backtest --out demo

docs: export OPENBLAS_NUM_THREADS := 1
docs: export OMP_NUM_THREADS := 1
docs: .venv/.docs ## build the documents from executed sources; a warning is an error
	@rm -rf build/docs
	$(BIN)/python -m sphinx -W --keep-going -n -q -E -j 2 docs build/docs
	@echo "The first page: $(CURDIR)/build/docs/index.html"

# Two test processes share two cores, so each does its linear algebra on one thread.
test: export OPENBLAS_NUM_THREADS := 1
test: export OMP_NUM_THREADS := 1
test: .venv/.core ## lint, types, layout, unit tests, doctests, documents and examples (four to nine minutes on two cores)
	@$(MAKE) --no-print-directory -j 2 lint types imports units

# The tests begin while types are still checked, which from nothing takes half a minute longer than all kernels, on one core.
units: kernels .venv/.test
	$(BIN)/pytest -n 2 --dist worksteal

# Once and on both cores: the demo would compile them on one, test processes the same ones side by side. It needs no more than
# the package itself, so the tools of the tests are installed meanwhile.
kernels: .venv/.core
	$(BIN)/inscrutable compile

lint: .venv/.test ## style and formatting
	$(BIN)/ruff check --quiet .
	$(BIN)/ruff format --quiet --check .

types: .venv/.test ## static types
	$(BIN)/mypy

imports: .venv/.test ## a step of the story imports only from the steps above it
	$(BIN)/lint-imports --no-logo

bench: .venv/.test ## measure everything against its peers, into benchmarks/results (minutes; let nothing else run)
	$(BIN)/python -m benchmarks

audit: .venv/.test ## the checks that take longer, a share of the files on each core; their log is kept in audit/log.txt
	$(BIN)/python tools/audit.py

clean: ## remove the environment, the caches and the demo
	rm -rf .venv .pytest_cache .mypy_cache .ruff_cache .import_linter_cache .hypothesis build dist demo docs/made
	find src tests tools benchmarks -name __pycache__ -type d -prune -exec rm -rf {} +

# ---- the environment: made once, renewed when a requirement changes -----------------------------

comma := ,
EXTRAS := test docs global data bench audit

define install
	@echo "Installing into .venv (a minute or two the first time) ..."
	@$(BIN)/python -m pip install -qq --no-compile -c constraints.txt $(1) || { \
		echo; \
		echo "The installation failed; pip's reason is above."; \
		echo "A broken connection, a timeout, or versions said to be missing or in conflict mean that the package"; \
		echo "index was out of reach: run the same command again, what was downloaded is kept."; \
		echo "If .venv itself is damaged: make clean, then the same command."; \
		exit 1; } >&2
endef

# Added to the package, which stays as it is: its kernels may be compiling.
.venv/.test: pyproject.toml constraints.txt | .venv/.core
	@$(BIN)/python -c 'import tomllib; of = tomllib.load(open("pyproject.toml", "rb"))["project"]["optional-dependencies"]; \
		print(*(each for name in "$(EXTRAS)".split() for each in of[name]), sep="\n")' >.venv/extras.txt
	$(call install,-r .venv/extras.txt)
	@touch .venv/.docs $@

.venv/.core: pyproject.toml constraints.txt | $(BIN)/pip
	$(call install,-e '.[report]')
	@touch $@

.venv/.docs: pyproject.toml constraints.txt | $(BIN)/pip
	$(call install,-e '.[docs$(comma)report]')
	@touch .venv/.core $@

$(BIN)/pip:
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] < (3, 14))' 2>/dev/null || { \
		echo "Python 3.11, 3.12 or 3.13 is needed; '$(PYTHON) --version' says: $$($(PYTHON) --version 2>&1)"; \
		echo "Name another one: make PYTHON=python3.12 ..."; \
		exit 1; } >&2
	@$(PYTHON) -m venv .venv || { \
		echo "'$(PYTHON) -m venv' failed; on Debian and Ubuntu: apt install python3-venv"; \
		exit 1; } >&2
	@# With it installing takes 25 s of processor time, with that of Python 3.11 45; where it cannot be had, the older one serves.
	@$(BIN)/python -m pip install -qq --no-compile --upgrade -c constraints.txt pip || true
