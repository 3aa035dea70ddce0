# The two commands of the README: `make train` and `make test`. Each makes .venv by itself.
PYTHON ?= python3
ENV ?= CartPole-v1
ARGS ?=
# beyond [dev]; with sb3, which is a gigabyte, the tests of its teachers run, too
EXTRAS ?=

.DEFAULT_GOAL := help
.PHONY: help install extras train test lint docs bench clean

help:            ## what there is
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*##/\t/'

.venv/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	.venv/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	@touch $@

install: .venv/.installed  ## make .venv and install everything into it

train: install   ## train a tree: make train ENV=Pendulum-v1 ARGS='--seed 1'
	.venv/bin/sympol train $(ENV) $(ARGS)

lint: install    ## ruff and pyright
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/pyright

docs: install    ## the documentation, into site/; a broken link is an error
	NO_MKDOCS_2_WARNING=1 .venv/bin/mkdocs build --strict --quiet

extras: install
	$(if $(EXTRAS),.venv/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[$(EXTRAS)]')

test: extras lint docs  ## everything CI runs
	tests/install-tools.sh
	.venv/bin/pytest -n 2 --dist loadfile

bench: install   ## measure what is claimed to be fast, into studies/results/
	.venv/bin/python -m studies.benchmarks

clean:           ## remove what was made
	rm -rf .venv .pytest_cache .ruff_cache build dist site
