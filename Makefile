# The two commands of the README: `make train` and `make test`. Each makes .venv by itself.
PYTHON ?= python3
ENV ?= CartPole-v1
ARGS ?=
# what the tests need beyond [dev]; with sb3, which is a gigabyte, those of its teachers run, too
EXTRAS ?= envpool

.DEFAULT_GOAL := help
.PHONY: help install train test lint docs bench clean

help:            ## what there is
	@grep -hE '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:[^#]*##/\t/'

.venv/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv .venv
	.venv/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[dev]'
	@touch $@

# large, and needed for LunarLander alone
.venv/.envpool: .venv/.installed
	.venv/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[envpool]'
	@touch $@

install: .venv/.installed  ## make .venv and install everything into it

train: $(if $(filter LunarLander%,$(ENV)),.venv/.envpool,install)  ## train a tree: make train ENV=Pendulum-v1 ARGS='--seed 1'
	.venv/bin/sympol train $(ENV) $(ARGS)

lint: install    ## ruff and pyright
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/pyright

docs: install    ## the documentation, into site/; a broken link is an error
	.venv/bin/mkdocs build --strict --quiet

.venv/.extras: .venv/.installed
	.venv/bin/python -m pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[$(EXTRAS)]'
	@touch $@

test: .venv/.extras lint docs  ## everything CI runs
	tests/install-tools.sh
	.venv/bin/pytest -n 2 --dist loadfile

bench: install   ## measure what is claimed to be fast, into results/
	.venv/bin/python -m benchmarks

clean:           ## remove what was made
	rm -rf .venv .pytest_cache .ruff_cache build dist site
