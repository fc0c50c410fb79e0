VENV   := .venv
PYTHON := $(VENV)/bin/python
STAMP  := $(VENV)/installed
PIP    := $(PYTHON) -m pip install --quiet --disable-pip-version-check
# It installs in a quarter of pip's time; where it cannot, as behind a mirror known to pip alone, pip does.
UV     := UV_SYSTEM_CERTS=1 UV_NATIVE_TLS=1 $(PYTHON) -m uv
DEBIAN := mesa-vulkan-drivers chromium gcc libc6-dev
INSTALL := apt-get update -qq && apt-get install -y -qq --no-install-recommends $(DEBIAN) >/dev/null
PROCESSES := 2
PYTEST = $(PYTHON) -m pytest -n $(PROCESSES) --dist loadfile --no-loadscope-reorder

.PHONY: demo ready check test soak counts strength lint docs bench bounds clean picture-packages

demo: $(STAMP)
	$(VENV)/bin/flighttune fly scenarios/paper.toml --out runs/paper

# Images of containers often set it: each of some hundred processes of the tests would then compile
# all that it imports anew, which takes half of the time of a short command.
unexport PYTHONDONTWRITEBYTECODE

# With two workers on two cores, threads of BLAS would spend their time waiting for each other.
check test soak counts strength: export OPENBLAS_NUM_THREADS = 1

# The inner loop of whoever changes the code: style, the fast tests, and the types of the files that differ
# from the main branch, checked while the tests run. The types of all files take longer than these tests;
# `make test` checks them, and so does this where git knows no main branch.
TYPED := flighttune benchmarks docs
check: $(STAMP)
	$(VENV)/bin/ruff check .
	$(VENV)/bin/ruff format --check .
	if base=$$(git merge-base HEAD origin/main 2>/dev/null); \
	then changed=$$( { git diff --name-only --diff-filter=d $$base -- $(TYPED); \
	git ls-files --others --exclude-standard -- $(TYPED); } | grep '\.py$$' ); \
	else changed=$(VENV); fi; \
	{ [ -z "$$changed" ] || $(VENV)/bin/pyright $${changed#$(VENV)}; } > $(VENV)/pyright.txt 2>&1 & types=$$!; \
	$(PYTEST) -m "not (slow or soak or counts)"; tests=$$?; \
	wait $$types; status=$$?; cat $(VENV)/pyright.txt; [ $$tests = 0 ] && [ $$status = 0 ]

# The types of all files take longer than the tests: `make check` looks at those that differ, CI at all.
test: ready
	$(WARM)
	$(PYTEST) -m $(SELECTED)

# Kernels that each process of the tests would compile: of aircraft and navigation, and of campaigns.
SELECTED := "not (soak or counts)"
WARM = $(PYTHON) tests/compile_kernels.py & rm -rf $(VENV)/compiled; \
	$(VENV)/bin/flighttune --workers 1 campaign first_campaign --runs 4 -q --out $(VENV)/compiled; wait $$!

# What takes long: whole commands, campaigns, missions, benchmarks, every picture at every size. Browsers,
# servers and processes that are killed wait much: a third process uses that time.
soak: PROCESSES := 3
soak: ready
	$(PYTEST) -m "soak and not counts"

# Thousands of cases of what the other tests prove on a few; prints what became of every kind of file.
counts: ready
	$(PYTEST) -m counts -rP

# Breaks LINES lines of the package on purpose, one after the other, and counts those that the tests
# notice; in a clone of its own, which it writes to. The same SEED draws the same lines.
LINES := 60
strength: ready
	rm -rf build/strength && git clone -q . build/strength
	cd build/strength && export PYTHONPATH=$$PWD/tests:$$PWD && \
	$(abspath $(PYTHON)) -m strength learn && \
	$(abspath $(PYTHON)) -m strength score --lines $(LINES) $(if $(SEED),--seed $(SEED))

# The hooks of .pre-commit-config.yaml, which look at what git tracks; an unpacked archive has no git.
lint: $(STAMP)
	if git rev-parse --git-dir >/dev/null 2>&1; \
	then PRE_COMMIT_HOME=$(VENV)/pre-commit $(VENV)/bin/pre-commit run --all-files --show-diff-on-failure; \
	else $(VENV)/bin/ruff check . && $(VENV)/bin/ruff format --check . && $(VENV)/bin/pyright; fi

bench: $(STAMP)
	$(PYTHON) benchmarks/all.py

# The site, from the repository's pages and the docstrings; a warning is an error.
docs: $(STAMP)
	$(VENV)/bin/sphinx-build -q -W --keep-going -b html -c docs . build/site
	@echo "build/site/docs/index.html"

# The lowest and the newest versions of the dependencies, and wheels for other systems; minutes.
bounds: $(STAMP)
	$(PYTHON) tests/bounds.py $(PYTHONS)

clean:
	rm -rf $(VENV) runs dist build .pytest_cache .ruff_cache .hypothesis .benchmarks
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(STAMP): pyproject.toml
	test -x $(PYTHON) || python3 -m venv $(VENV)
	$(PIP) 'uv>=0.5,<1' && $(UV) pip install --quiet --python $(PYTHON) --editable '.[dev]' \
	|| $(PIP) --editable '.[dev]'
	touch $@

# A new machine gets packages of Python and of Debian at the same time.
ready:
	@$(MAKE) --no-print-directory -j2 $(STAMP) picture-packages

# The picture tests look at recordings in a headless viewer, which needs a software Vulkan driver, and
# at pages in a browser; exported C needs a compiler. They are installed where this can be done
# without a password; elsewhere those tests say that they were skipped.
picture-packages:
	@if dpkg -s $(DEBIAN) >/dev/null 2>&1; then :; \
	elif [ "$$(id -u)" = 0 ]; then $(INSTALL); \
	elif sudo -n true 2>/dev/null; then sudo -n sh -c '$(INSTALL)'; \
	else echo "$(DEBIAN): not installed, and cannot be here; the picture tests will be skipped"; fi
