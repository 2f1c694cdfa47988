# SPDX-License-Identifier: MIT
# `make demo` and `make test` set up what they need: packages, build, installation.

PY := /usr/bin/python3
BUILD := build
CMAKE_FLAGS ?=
TIMEOUT ?= 2400
TESTS ?= tests

SUDO := $(if $(filter-out 0,$(shell id -u)),sudo)
PACKAGES := $(shell sed 's/\#.*//' packages.debian)
DOCS_PACKAGES := python3-sphinx python3-myst-parser python3-sphinx-rtd-theme libjs-mathjax
TIDY_PACKAGES := clang-tidy
CPP_FILES = $(shell find cpp -name '*.h' -o -name '*.cpp')

# One BLAS thread a process; pictures go to files; more ranks than cores are welcome, whatever the
# version of Open MPI (Debian 12 | 13 | unstable), as root in a container too.
OMP_NUM_THREADS ?= 1
MPLBACKEND := Agg
OMPI_ALLOW_RUN_AS_ROOT := 1
OMPI_ALLOW_RUN_AS_ROOT_CONFIRM := 1
OMPI_MCA_rmaps_base_oversubscribe := 1
PRTE_MCA_rmaps_default_mapping_policy := :oversubscribe
PRTE_MCA_mapby := :oversubscribe
OMPI_MCA_btl_vader_single_copy_mechanism := none
export OMP_NUM_THREADS MPLBACKEND OMPI_ALLOW_RUN_AS_ROOT OMPI_ALLOW_RUN_AS_ROOT_CONFIRM \
  OMPI_MCA_rmaps_base_oversubscribe PRTE_MCA_rmaps_default_mapping_policy PRTE_MCA_mapby \
  OMPI_MCA_btl_vader_single_copy_mechanism

.PHONY: help demo demos test install packages all-packages ctest pytest-1 pytest-2 pytest-3 test-debian test-sanitize tidy \
  bench bench-solvers robustness faults docs gallery format check-format clean
.NOTPARALLEL:

help:
	@echo "make demo          press two blocks together and draw the contact pressure"
	@echo "make demos         run all demos and draw their pictures"
	@echo "make test          C++ and Python tests, on 1, 2 and 3 MPI ranks"
	@echo "make install       build, and install the Python package for $(PY)"
	@echo "make test-debian   the same inside Debian RELEASE=bookworm, trixie or sid; writes docs/versions.md"
	@echo "make test-sanitize C++ and Python tests with address and undefined-behaviour sanitizers"
	@echo "make tidy          checks of clang-tidy"
	@echo "make bench         what contact costs and how it grows, beside the bulk and GetFEM; takes long"
	@echo "make bench-solvers MUMPS and the iterative solver up to 4e5 dofs; takes long, and 14 GB"
	@echo "make docs          the documentation, in $(BUILD)/docs/index.html"
	@echo "make gallery       run the demos anew and put their pictures into the documentation"
	@echo "make robustness    60 runs with default settings; writes docs/robustness.md"
	@echo "make faults        a thousand bad inputs on 1 and 2 ranks; writes docs/faults.md"
	@echo "make format        format C++ and Python; make check-format only checks"
	@echo "make clean         remove $(BUILD)/"

demo: install
	$(PY) demos/two_blocks.py

# a few minutes; the tests run each of them at a small size
demos: demo
	$(PY) demos/two_cubes.py
	$(PY) demos/sphere_on_block.py
	$(PY) demos/hertz.py
	$(PY) demos/cord.py
	$(PY) demos/cattaneo.py
	$(PY) demos/wedge.py
	$(PY) demos/ironing.py
	$(PY) demos/drag_and_turn.py
	$(PY) demos/rubber.py
	$(PY) demos/sheet.py
	$(PY) demos/indentation.py
	$(PY) demos/elastoplastic_sphere.py

# The C++ tests are compiled, with low priority, while the Python tests run on one rank. A failure of
# one stage leaves the others to tell of theirs.
test: install
	@log=$(BUILD)/compile.log; failed=; \
	nice cmake --build $(BUILD) --target contact_tests >$$log 2>&1 & compile=$$!; \
	$(MAKE) INSTALLED=1 pytest-1 || failed="$$failed pytest-1"; \
	wait $$compile || cat $$log; \
	for s in ctest pytest-2 pytest-3; do $(MAKE) INSTALLED=1 $$s || failed="$$failed $$s"; done; \
	test -z "$$failed" || { echo "make test failed in$$failed"; exit 1; }

# --- set-up ----------------------------------------------------------------------------------

all-packages: PACKAGES += $(DOCS_PACKAGES) $(TIDY_PACKAGES)
all-packages: packages

# Installs what is missing of packages.debian; elsewhere than on Debian leaves it to the user.
packages:
	@command -v apt-get >/dev/null || { echo "No apt-get here: see packages.debian for what is needed"; exit 0; }; \
	missing=; \
	for p in $(PACKAGES); do \
	  test "$$(dpkg-query -W -f '$${db:Status-Status}' $$p 2>/dev/null)" = installed || missing="$$missing $$p"; \
	done; \
	test -z "$$missing" || { echo "Installing$$missing" \
	  && $(SUDO) apt-get -qq -o DPkg::Lock::Timeout=300 update </dev/null \
	  && $(SUDO) env DEBIAN_FRONTEND=noninteractive apt-get -o DPkg::Lock::Timeout=300 \
	       install -y --no-install-recommends $$missing </dev/null; }

$(BUILD)/build.ninja: CMakeLists.txt | packages
	cmake -S . -B $(BUILD) -G Ninja -DPython3_EXECUTABLE=$(PY) $(CMAKE_FLAGS)
	@touch $@

install: packages $(BUILD)/build.ninja
	cmake --build $(BUILD) --target dolfinx_contact_core _cpp
	@dir=$$($(PY) -c 'import sysconfig; print(sysconfig.get_path("platlib"))'); \
	while ! test -e "$$dir"; do dir=$$(dirname "$$dir"); done; \
	if test -w "$$dir" && test -w /usr/local/lib; then sudo=; else sudo="$(SUDO)"; fi; \
	$$sudo cmake --install $(BUILD)

# --- tests -----------------------------------------------------------------------------------

ctest: packages $(BUILD)/build.ninja
	cmake --build $(BUILD) --target contact_tests
	cd $(BUILD) && timeout --foreground -k 10 $(TIMEOUT) ctest --output-on-failure --no-tests=error </dev/null

# One process prints (tests/conftest.py); a failure of any, or a hang, fails the target.
pytest-1 pytest-2 pytest-3: pytest-%: $(if $(INSTALLED),,install)
	timeout --foreground -k 10 $(TIMEOUT) mpirun -n $* $(PY) -m pytest -q --color=no -p no:cacheprovider --durations=12 $(TESTS) </dev/null

# In a root file system of another Debian release, made once in ROOTS; see .ci/debian.
RELEASE ?= trixie
ROOTS ?= $(BUILD)/debian
STAGES ?=
test-debian:
	$(SUDO) env RELEASE=$(RELEASE) ROOTS=$(ROOTS) PACKAGES="$(PACKAGES)" STAGES="$(STAGES)" TESTS="$(TESTS)" .ci/debian

# C++ tests of the files cpp/test/test_NAME.cpp, and Python tests with the extension module. Python
# itself knows nothing of sanitizers: their libraries are loaded before it, with C++'s for exceptions.
# OpenBLAS's zgemv for Haswell, which only NumPy calls here, crashes beside them: its older kernels.
SANITIZED := $(BUILD)/sanitize
SANITIZE_CPP ?= *
SANITIZE_PY ?= test_assembly.py test_exchange.py test_friction.py test_parallel.py test_pattern.py \
  test_plasticity.py test_problem.py test_rigid_mesh.py test_segments.py test_sheet.py test_tools.py
test-sanitize: packages
	cmake -S . -B $(SANITIZED) -G Ninja -DPython3_EXECUTABLE=$(PY) -DDOLFINX_CONTACT_SANITIZE=ON \
	  -DDOLFINX_CONTACT_TESTS="$$(echo '$(SANITIZE_CPP)' | tr ' ' ';')" $(CMAKE_FLAGS)
	cmake --build $(SANITIZED) --target contact_tests $(if $(SANITIZE_PY),_cpp)
	mkdir -p $(SANITIZED)/dolfinx_contact
	cp dolfinx_contact/*.py $(SANITIZED)/dolfinx_contact
	cd $(SANITIZED) && ASAN_OPTIONS=detect_leaks=0 \
	  ctest -R contact_tests -E mpi_3 --output-on-failure --no-tests=error </dev/null
	$(if $(SANITIZE_PY),cd $(SANITIZED) && ASAN_OPTIONS=detect_leaks=0 OPENBLAS_CORETYPE=Nehalem \
	  LD_PRELOAD="$$(echo $$(for l in asan ubsan stdc++; do g++ -print-file-name=lib$$l.so; done))" \
	  timeout --foreground -k 10 $(TIMEOUT) $(PY) -m pytest -q --color=no -p no:cacheprovider \
	  $(addprefix $(CURDIR)/tests/,$(SANITIZE_PY)) </dev/null)

# Headers are seen through the files that include them. TIDY: some of the library's files
TIDY ?= $(wildcard cpp/*/*.cpp)
tidy: PACKAGES += $(TIDY_PACKAGES)
tidy: packages $(BUILD)/build.ninja
	printf '%s\n' $(filter-out cpp/test/% cpp/bench/%,$(TIDY)) | xargs -P 2 -n 1 clang-tidy -p $(BUILD) --quiet

# GetFEM is for the comparison only. Rewrites docs/scaling.md and its picture.
bench: PACKAGES += python3-getfem
bench: install
	cmake --build $(BUILD) --target contact_bench
	$(BUILD)/contact_bench
	$(PY) benchmarks/scaling.py --output docs/scaling.md
	$(PY) benchmarks/parallel.py --compare 2
	$(PY) benchmarks/exchange.py
	$(PY) benchmarks/long_run.py
	$(PY) benchmarks/memory.py --solver iterative --layers 38
	$(PY) benchmarks/getfem_comparison.py
	$(PY) benchmarks/junctions.py
	$(PY) benchmarks/rules.py
	$(PY) benchmarks/convergence.py
	$(PY) benchmarks/infsup.py --small
	$(PY) benchmarks/locking.py
	$(PY) benchmarks/material.py

# MUMPS with 4e5 dofs takes most of the time, and 14 GB (docs/linear_solvers.md)
bench-solvers: install
	$(PY) benchmarks/solvers.py --output docs/linear_solvers.md

# 60 runs, about five minutes; rewrites the table of docs/robustness.md
robustness: install
	$(PY) benchmarks/robustness.py --output docs/robustness.md

# Bad inputs, on 1 and 2 ranks, about five minutes; rewrites docs/faults.md
faults: install
	$(PY) benchmarks/bad_input.py --output docs/faults.md

# --- documentation ---------------------------------------------------------------------------

# Sphinx is for the documentation only. Every warning is an error.
docs: PACKAGES += $(DOCS_PACKAGES)
docs: install
	$(PY) -m sphinx -q -W --keep-going -d $(BUILD)/docs-cache docs $(BUILD)/docs
	@echo "Open $(BUILD)/docs/index.html"

gallery: demos
	$(PY) docs/figures.py

# --- the source's looks ----------------------------------------------------------------------

format: packages
	clang-format -i $(CPP_FILES)
	$(PY) -m black -q -l 99 .

check-format: packages
	clang-format --dry-run -Werror $(CPP_FILES)
	$(PY) -m black --check -l 99 .

clean:
	test ! -d $(BUILD)/debian || $(SUDO) rm -rf $(BUILD)/debian
	rm -rf $(BUILD)
