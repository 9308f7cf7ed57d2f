# `make demo` and `make test` need nothing but Python (3.10 or newer, with venv) and make.

PYTHON ?= python3
VENV ?= .venv
OUT ?= out/demo

bin := $(VENV)/bin
installed := $(VENV)/.installed

.PHONY: demo app test docs coverage fuzz bounds lint wheel clean

demo: $(installed)  ## invert a photograph, write pictures, figures and a page into out/demo
	$(bin)/nablahog demo -o $(OUT)

app: $(installed)  ## the page in the browser: see a HOG, invert it, fit a pose
	$(bin)/nablahog app

test: $(installed)  ## all tests but the slow ones
	$(bin)/python -m pytest -n auto --dist worksteal

docs: $(installed)  ## the site, build/docs/html/index.html, without a network
	$(bin)/python -m sphinx --builder html --nitpicky --fail-on-warning --keep-going --quiet \
	    --doctree-dir build/docs/doctrees docs build/docs/html
	$(bin)/python -m docs.check_links build/docs/html

coverage: $(installed)  ## the same, with the lines that no test runs
	$(bin)/python -m pytest --cov=nablahog --cov-report=term-missing:skip-covered

fuzz: $(installed)  ## half an hour of hostile input: specs, descriptors, files, kills, caches
	$(bin)/python -m tests.fuzz

bounds: $(installed)  ## the tests with the lowest and the newest versions allowed, on each Python found (ARGS="tests/io")
	$(bin)/python -m pip install --quiet uv
	PATH="$(abspath $(bin)):$$PATH" .ci/bounds $(ARGS)

lint: $(installed)  ## style and types
	$(bin)/ruff check .
	$(bin)/ruff format --check .
	$(bin)/mypy
	MYPYPATH=benchmarks:. $(bin)/mypy --allow-untyped-calls --follow-imports silent benchmarks docs

wheel: $(installed)  ## a wheel for this version of Python, with machine code for this kind of processor
	.ci/wheel $(bin)/python

# the stamp is made last, so an installation that failed is tried again
$(installed): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(bin)/python -m pip install -c constraints.txt -e '.[dev]'
	touch $@

clean:  ## what the other targets made, except the virtual environment
	rm -rf out build dist docs/api/generated docs/auto_gallery docs/auto_tutorials .coverage .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find src tests -name __pycache__ -type d -prune -exec rm -rf {} +
