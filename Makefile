.PHONY: install run test lint docs

install:
	pip install -c constraints.txt ".[dev,docs,imagenet,parallel]"

run:
	python -m tex_lightning model=fusion

test:
	python -m pytest

lint:
	ruff check . && ruff format --check . && mypy && lint-imports

docs:
	sphinx-build -W docs outputs/docs
