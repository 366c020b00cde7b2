# Needs a Python from 3.11 to 3.13 and make; everything else goes into .venv.

SHELL := /bin/sh
.SHELLFLAGS := -eu -c
.ONESHELL:
.PHONY: help setup up test gate gate-afresh brief interop ros2-check clients-table rows-table mutation bench speed evidence hashes generate docs prose refresh pictures same-bits same-bits-mcu generate-docs clean afresh compiled study firmware

PYTHONS := python3.13 python3.12 python3.11 python3
BIN := $(CURDIR)/.venv/bin
# Written last and holding the place it was made for: a set-up that was interrupted, or moved, or
# whose Python is gone, is made afresh.
READY := .venv/ready
USABLE := $(shell [ -x .venv/bin/python ] && [ "$$(cat $(READY) 2>&1)" = "$(CURDIR)" ] && echo yes)

help:
	@echo "make setup   the virtual environment .venv with everything in it"
	echo "make up      plant, robot and a goal; ARGS=\"--world u_trap --navigator bug\" for another run"
	echo "make firmware  the control core for an emulated LPC1768, in build/firmware"
	echo "make test    the checks for each change, about two minutes; ARGS=\"ground/client\" for the tests of a room"
	echo "make gate    every check, about fourteen minutes; needs Docker, a compiler, an emulator and a browser"
	echo "make gate-afresh  .ci/run on a system without anything, made by debootstrap; as root"
	echo "make brief   choose the tests of make test again, after new modules"
	echo "make ros2-check  the ros2 command line against a robot, in a container of ROS; ARGS=kilted"
	echo "make mutation  change the modules a stop depends on, bit by bit: does a test notice?"
	echo "make same-bits  compares digests of a thousand trials with other Pythons, libraries and processor features"
	echo "make same-bits-mcu  compares digests of all worlds and navigators with the emulated board"
	echo "make study   a study with compiled modules; ARGS=\"--quick\" is handed on"
	echo "make bench   measurements; ARGS=... is handed on"
	echo "make speed   ratios of speed, and what has moved; ARGS=\"--against COMMIT\" compares with that commit"
	echo "make evidence  measure the pages of docs/evidence again; ARGS=--list shows them with minutes"
	echo "make hashes  the hashes of all packages that the images install"
	echo "make generate  the modules made from protocol/dialect/sidestep.xml and ground/commands"
	echo "make docs    the documentation as a web site, in build/site"
	echo "make generate-docs  the committed pages that are made from the code"
	echo "make prose   suggestions for plainer English, never an error; ARGS=\"docs/how-to\" for a part"
	echo "make refresh  renew screens and outputs on pages, and show the difference; ARGS=\"screens\""
	echo "make pictures  the drawings in docs/pictures"
	echo "make clean   remove .venv and what the tools have cached"

setup: $(READY)

# The lock: whoever sets up at the same time, or was left over by an interruption, comes first.
$(READY): pyproject.toml constraints.txt $(if $(USABLE),,afresh)
	@exec 9<Makefile
	flock 9
	usable() { [ -x .venv/bin/python ] && [ "$$(cat $@ 2>&1)" = "$(CURDIR)" ]; }
	if usable && [ -z "$$(find pyproject.toml constraints.txt -newer $@)" ]; then exit 0; fi
	if [ ! -w . ]; then
		echo "make setup: $(CURDIR) is read-only, so .venv cannot be made or renewed in it." >&2
		echo "            Copy the checkout, or: uvx --from $(CURDIR) sidestep up" >&2
		exit 1
	fi
	if usable; then
		echo "Bringing .venv up to date."
		rm $@
	else
		rm -f $@
		python= without_venv=
		for candidate in $(PYTHONS); do
			fits='import sys; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))'
			"$$candidate" -c "$$fits" >/dev/null 2>&1 || continue
			if "$$candidate" -c 'import ensurepip, venv' >/dev/null 2>&1; then
				python=$$candidate
				break
			fi
			without_venv=$$candidate
		done
		if [ -z "$$python" ] && [ -n "$$without_venv" ]; then
			echo "make setup: $$without_venv cannot make virtual environments." >&2
			echo "            On Debian and Ubuntu: apt install $$without_venv-venv" >&2
			exit 1
		fi
		if [ -z "$$python" ]; then
			echo "make setup: no Python from 3.11 to 3.13 found (tried: $(PYTHONS))." >&2
			echo "            On Debian and Ubuntu: apt install python3 python3-venv" >&2
			exit 1
		fi
		echo "Setting up .venv with $$("$$python" --version); this takes about a minute, at most 90 s."
		"$$python" -m venv --clear .venv
	fi
	# A line every ten seconds, or on a terminal one that changes; it ends with this shell.
	show() {
		seconds=0
		while sleep 1 >/dev/null 2>&1 && kill -0 $$$$ 2>/dev/null; do
			seconds=$$((seconds + 1))
			found=$$(grep -c '^Collecting ' .venv/setup.log) || :
			line="  $$found of about $$(grep -c == constraints.txt) packages found"
			! grep -q '^Installing collected' .venv/setup.log || line="  all packages found, installing them"
			if [ -t 1 ]; then
				printf '\r\033[K%s, %s s ' "$$line" $$seconds
			elif [ $$((seconds % 10)) = 0 ]; then
				echo "$$line, $$seconds s"
			fi
		done
	}
	# The build tools come first and from the same list, so nothing unpinned is ever fetched. pip would
	# compile every module of every package; most are never imported, and others are at their first.
	install() {
		code=0
		show 9<&- & shown=$$!
		"$(BIN)/python" -m pip --disable-pip-version-check --no-input install --no-compile \
			-c constraints.txt "$$@" >.venv/setup.log 2>&1 || code=$$?
		kill $$shown
		[ ! -t 1 ] || printf '\r\033[K'
		[ $$code != 0 ] || return 0
		cat .venv/setup.log >&2
		echo "make setup: pip could not install $$*; its own words are above." >&2
		exit 1
	}
	install hatchling editables
	install --no-build-isolation -e '.[dev]'
	"$(BIN)/sidestep" --version
	printf '%s\n' "$(CURDIR)" >$@

# With the compiled modules that `make study` has built, if there are those of these very sources.
up: setup
	@compiled=
	[ ! -d build/compiled ] || compiled=$$("$(BIN)/python" -m checks.built compiled --installed)
	[ -z "$$compiled" ] || export PYTHONPATH="$$compiled"
	exec "$(BIN)/sidestep" up $(ARGS)

# The compiled modules are kept for all checkouts, by the content of their sources; see
# checks/built.py.
compiled: setup
	@"$(BIN)/python" -m checks.built compiled build/compiled

# Several times as fast as with pure Python, with the same results.
study: compiled
	@PYTHONPATH="$(CURDIR)/build/compiled" exec "$(BIN)/python" -P -m sidestep study $(ARGS)

# Needs packages of Debian, which it names when they are missing.
firmware: setup
	@exec "$(BIN)/python" -m checks.built firmware $(ARGS)

bench: setup
	@exec "$(BIN)/sidestep" bench $(ARGS)

# Some minutes, with nothing beside it. ARGS=--record appends a row to the history, ARGS="trial codec"
# measures a part; see checks/site/speed.py.
speed: setup
	@exec "$(BIN)/python" -m checks.site.speed $(ARGS)

# Hours; it continues where it was interrupted. ARGS="figures compiled" measures only these pages,
# ARGS="--max-minutes 20" those that take at most so long, and ARGS=--list shows all.
evidence: setup
	@exec "$(BIN)/python" -m checks.evidence --measure $(ARGS)

# The steps are in checks/gate.py. With CI set a skipped test fails.
test: setup
	@PATH="$(BIN):$$PATH"
	exec "$(BIN)/python" -m checks.gate $(if $(ARGS),room,test) $(ARGS) $(if $(CI),--no-skips)

# Everything: `test`, then the rest; ARGS=rest leaves out what `make test` has run.
gate: setup
	@PATH="$(BIN):$$PATH"
	exec "$(BIN)/python" -m checks.gate $(or $(ARGS),gate) $(if $(CI),--no-skips)

# It keeps the packages it fetches in build/afresh, and nothing else.
gate-afresh:
	@exec .ci/afresh $(ARGS)

# About a quarter of an hour; writes tests/brief.txt.
brief: setup
	@exec "$(BIN)/python" -m checks.brief $(ARGS)

# A client that cannot be installed is skipped with the reason, and fails with CI set. Each client
# drives a robot in real time: four at once are not late on two cores.
interop: setup
	@PATH="$(BIN):$$PATH"
	exec "$(BIN)/python" -m pytest -q -n 4 --dist worksteal -m interop $(if $(CI),--no-skips) $(ARGS) tests/interop

# The rows of docs/reference/ros2-rows.md that need a real ROS, in a container of it: jazzy, or ARGS=kilted.
ros2-check:
	@exec docker run --rm -v "$(CURDIR):/sidestep:ro" "ros:$(or $(ARGS),jazzy)-ros-base" \
		bash /sidestep/tests/interop/ros2/real_ros.sh container

# From the results of `make interop`.
clients-table: setup
	@exec "$(BIN)/python" -m checks.site.interop_tables clients

rows-table: setup
	@exec "$(BIN)/python" -m checks.site.interop_tables rows

# Some minutes; ARGS="--module guard" tries one module.
mutation: setup
	@exec "$(BIN)/python" -m checks.mutation $(ARGS)

# About half an hour; ARGS="--python FILE" adds an interpreter, of another C library for instance,
# and ARGS="--page docs/evidence/same-bits.md" writes the page.
same-bits: setup
	@exec "$(BIN)/python" -m checks.same_bits --libraries --compiled $(ARGS)

# About half an hour; it continues where it was interrupted. ARGS="--minutes 10" ends earlier.
same-bits-mcu: setup
	@"$(BIN)/python" -m checks.built firmware
	exec "$(BIN)/python" -m checks.same_bits.on_board $(ARGS)

# Some minutes; after a change of constraints.txt or of what pyproject.toml wants. The lists hold the
# files that pip chooses, of the index that it is configured for.
hashes: setup
	@exec "$(BIN)/python" -m checks.built hashes

generate: setup
	@"$(BIN)/python" -m protocol.dialect.generate
	"$(BIN)/python" -m checks.site.commands

docs: setup
	@exec "$(BIN)/python" -m checks.site

prose: setup
	@exec "$(BIN)/python" -m checks.language $(ARGS)

# Pages run for minutes in real time; ARGS="docs/tutorial/mission.md" or ARGS="screens" for a part.
refresh: setup
	@exec "$(BIN)/python" -m tests.support.refresh $(ARGS)

# The screens are filmed in real time, in tmux, about four minutes; ARGS="screen" films one.
pictures: setup
	@"$(BIN)/python" -m checks.site.pictures
	exec "$(BIN)/python" -m checks.site.film $(ARGS)

generate-docs: setup
	@"$(BIN)/python" -m checks.site.reference >docs/reference/protocol.md.new
	mv docs/reference/protocol.md.new docs/reference/protocol.md
	"$(BIN)/python" -m checks.model --document >docs/evidence/state-diagram.md.new
	mv docs/evidence/state-diagram.md.new docs/evidence/state-diagram.md
	"$(BIN)/python" -m checks.mutation --document >docs/evidence/mutants.md.new
	mv docs/evidence/mutants.md.new docs/evidence/mutants.md
	"$(BIN)/python" -m checks.site.microcontroller_page >docs/evidence/microcontroller.md.new
	mv docs/evidence/microcontroller.md.new docs/evidence/microcontroller.md

clean:
	rm -rf .venv .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache build *.egg-info
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
