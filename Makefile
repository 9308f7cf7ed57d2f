# `make demo` and `make test` need nothing but Python (3.10 or newer, with venv), make, and a C++ compiler (g++ 12 or
# clang++ 14, or newer). Without the compiler everything runs on plain PyTorch, many times slower.

PYTHON ?= python3
VENV ?= .venv
OUT ?= out/demo

bin := $(VENV)/bin
# each stamp is made last, so an installation that failed is tried again
tools := $(VENV)/.tools
package := $(VENV)/.package
development := $(VENV)/.development

.PHONY: demo app native loops test slow sanitize docs coverage fuzz mutants alone bounds generated lint wheels clean

demo: native  ## invert a photograph, write pictures, figures and a page into out/demo
	@echo "Inverting both descriptors of a photograph"
	@$(bin)/nablahog demo -o $(OUT)

app: native  ## the page in the browser: see a HOG, invert it, fit a pose
	$(bin)/nablahog app

native: $(tools)  ## the package and its compiled loops, these again where a source has changed
	@$(MAKE) --silent --jobs=2 $(package) loops

# ninja takes the cores by itself, not from the jobs of make
loops: $(tools)
	@echo "Compiling the loops for this processor, where they have changed: half a minute for all"
	@grep -qsxF "CMAKE_HOME_DIRECTORY:INTERNAL=$(CURDIR)" build/native/CMakeCache.txt || rm -rf build/native  # of a copy
	@unset MAKEFLAGS; if $(bin)/cmake --log-level=WARNING -S . -B build/native -G Ninja \
	    -DCMAKE_MAKE_PROGRAM="$(abspath $(bin)/ninja)" $(CMAKE_ARGS) >/dev/null; \
	    then $(bin)/cmake --build build/native -- --quiet; \
	    else echo "no C++ compiler: all runs on plain PyTorch, slowly"; fi

test slow sanitize docs coverage fuzz mutants alone generated: native $(development)

test:  ## all tests but the slow ones
	$(bin)/python -m pytest -n auto --dist worksteal

slow:  ## the slow tests, which .ci/run runs, too
	$(bin)/python -m pytest -n auto --dist worksteal -m "slow and not xslow"

sanitize:  ## the tests of the compiled loops under AddressSanitizer and UndefinedBehaviorSanitizer
	PATH="$(abspath $(bin)):$$PATH" .ci/sanitize $(ARGS)

docs:  ## the site, build/docs/html/index.html, without a network
	$(bin)/python -m sphinx --builder html --nitpicky --fail-on-warning --keep-going --quiet \
	    --doctree-dir build/docs/doctrees docs build/docs/html
	$(bin)/python -m docs.check_site build/docs/html

coverage:  ## test and slow, with the lines that no test runs
	$(bin)/python -m pytest -m "not xslow" --cov=nablahog --cov-report=term-missing:skip-covered

# fresh memory is full of large numbers, where it is glibc's: what is read before it is written shows
fuzz:  ## half an hour of hostile input, other every time: specs, descriptors, files, kills
	NABLAHOG_FUZZ=60 NABLAHOG_FUZZ_SEED=$$(date +%s) MALLOC_PERTURB_=128 \
	    $(bin)/python -m pytest tests/fuzz -n auto --dist worksteal -m "" $(ARGS)

mutants:  ## breaks 200 lines, one after the other, and lists those that no test notices (ARGS="--under hog pose --all")
	$(bin)/python -m tests.mutants $(ARGS)

alone:  ## tests in other orders, processes and surroundings, which must all give the same (ARGS="tests/viz tests/io")
	$(bin)/python -m tests.run_orders $(ARGS)

bounds: $(tools)  ## the tests with the lowest and the newest versions allowed, on each Python found (ARGS="tests/io")
	$(bin)/python -m pip install --quiet uv
	PATH="$(abspath $(bin)):$$PATH" .ci/bounds $(ARGS)

generated:  ## stubs, tables of the pages and the stored public surface, from the code that they repeat
	$(bin)/python -m tests.generated

lint: $(development)  ## style and types
	$(bin)/clang-format --dry-run -Werror src/nablahog/native/*.h src/nablahog/native/*.cpp benchmarks/*.cpp
	$(bin)/ruff check .
	$(bin)/ruff format --check .
	$(bin)/mypy
	MYPYPATH=benchmarks:. $(bin)/mypy --allow-untyped-calls --follow-imports silent benchmarks docs

wheels:  ## the source distribution and the wheels of all systems into dist/
	.ci/wheels

$(tools): pyproject.toml
	@echo "Making a virtual environment in $(VENV)"
	@$(PYTHON) -m venv $(VENV)
	@$(bin)/python -m pip install --quiet -c constraints.txt scikit-build-core cmake ninja
	@touch $@

# meanwhile the loops are compiled
$(package): $(tools) pyproject.toml constraints.txt
	@echo "Installing nablahog and the packages that it needs into $(VENV): 1.2 GB"
	@SKBUILD_WHEEL_CMAKE=0 $(bin)/python -m pip install -c constraints.txt --no-build-isolation -e '.[app]'
	@touch $@

$(development): pyproject.toml constraints.txt | native
	@echo "Installing the tools of the tests and of the documentation into $(VENV): 1.8 GB more"
	@SKBUILD_WHEEL_CMAKE=0 $(bin)/python -m pip install -c constraints.txt --no-build-isolation -e '.[dev]'
	@touch $@

clean:  ## what the other targets made, except the virtual environment
	rm -rf out build dist docs/api/generated docs/auto_gallery docs/auto_tutorials .coverage .pytest_cache .mypy_cache .ruff_cache .hypothesis
	rm -f src/nablahog/native/*.so src/nablahog/native/*.sha256
	find src tests -name __pycache__ -type d -prune -exec rm -rf {} +
