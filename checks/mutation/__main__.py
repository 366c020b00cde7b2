"""`python -m checks.mutation`: try all mutants, print the scores and the survivors.

The exit code is 1 if a mutant survives that is not listed as equivalent, or if the list is wrong.
It is 2 if the tests fail without any mutant.

With `--branches` it checks that unit tests take every branch of the kernel. The unit tests of
guard, failsafe, mode machine, lease, wheel-command validity, mailbox, codec and stop datagram must
take each branch of these modules, without any other test. The exit code is 1, with a list of the
missed branches, if they do not or if a test fails.
"""

import argparse
import os
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Final

import pytest
from coverage import Coverage

from checks.mutation.mutants import FILE, Identity, Mutant, load, mistakes, mutants_of, page
from checks.mutation.runner import BrokenTestsError, MutantVerdict, MutationTarget, verdicts

TARGETS: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {
        "robot/core/safety/guard.py": ("tests/unit/robot/core/test_guard.py",),
        "robot/core/safety/failsafe.py": (
            "tests/unit/robot/core/test_failsafe.py",
            "tests/unit/robot/core/test_place.py",
        ),
        "robot/core/modes.py": (
            "tests/unit/robot/core/test_modes.py",
            "tests/unit/robot/core/test_fence.py",
            "tests/unit/robot/core/test_place.py",
        ),
        "robot/core/place.py": ("tests/unit/robot/core/test_place.py",),
        "robot/core/perception/stall.py": ("tests/unit/robot/core/test_stall.py",),
        "robot/lease.py": ("tests/unit/robot/test_lease.py",),
        "robot/commands.py": (
            "tests/unit/robot/test_senses.py",
            "tests/unit/robot/test_commands.py",
            "tests/unit/robot/test_vehicle.py",
            "tests/unit/robot/test_lease.py",
        ),
        "robot/process.py": (
            "tests/unit/robot/test_process.py",
            "tests/unit/robot/test_process_stop.py",
            "tests/unit/robot/test_process_requests.py",
            "tests/unit/robot/test_scheduling.py",
        ),
        "robot/senses.py": (
            "tests/unit/robot/test_senses.py",
            "tests/unit/robot/test_process.py",
        ),
        "runtime/sequence.py": ("tests/unit/runtime/test_clock.py",),
        "robot/emergency_stop.py": ("tests/unit/robot/test_stop_latch.py",),
        "protocol/stop_datagram.py": ("tests/unit/protocol/test_stop_datagram.py",),
        "protocol/bus/mailbox.py": ("tests/unit/protocol/test_bus_mailbox.py",),
        "protocol/bus/robot_clock.py": ("tests/unit/protocol/test_bus_clock.py",),
        "plant/robot_link.py": ("tests/unit/plant/test_robot_link.py",),
        "protocol/wire/codec.py": ("tests/unit/protocol/test_wire_codec.py",),
    }
)
"""Source files with their tests, the module's own first."""


ROOT: Final = Path(__file__).resolve().parents[2]
KERNEL: Final = (
    "robot/core/safety/guard.py",
    "robot/core/safety/failsafe.py",
    "robot/core/modes.py",
    "robot/lease.py",
    "plant/robot_link.py",
    "protocol/bus/mailbox.py",
    "protocol/wire/codec.py",
    "protocol/stop_datagram.py",
)
"""Modules whose mutation tests must take each of their branches."""

OPTIONS: Final = (
    *("-q", "-p", "no:xdist", "-p", "no:cov", "-m", "not hypothesis"),
    *("-W", "ignore::pytest.PytestAssertRewriteWarning"),  # Hypothesis is already imported
)
"""Properties are left out: the written examples alone must take every branch."""


def check_branches() -> int:
    """Run the tests with coverage and return the exit code."""
    os.chdir(ROOT)
    tests = dict.fromkeys(test for module in KERNEL for test in TARGETS[module])
    coverage = Coverage(data_file=None, branch=True, include=[*KERNEL], config_file=False)
    with coverage.collect():
        failed = pytest.main([*OPTIONS, *tests])
    return int(failed) or int(coverage.report(show_missing=True) < 100.0)


ROW = "{:28} {:>7} {:>7} {:>8} {:>10} {:>9} {:>7} {:>6}"
HEADER = ROW.format(
    "module", "mutants", "killed", "timeouts", "equivalent", "survivors", "score", "s"
)


def main(arguments: Sequence[str]) -> int:
    """Run the command line and return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m checks.mutation", description=__doc__)
    parser.add_argument(
        "--module",
        action="append",
        default=[],
        metavar="PATH",
        help="module to mutate (all)",
    )
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="number of processes")
    parser.add_argument("--list", action="store_true", help="print the mutants and try none")
    parser.add_argument("--document", action="store_true", help="print docs/evidence/mutants.md")
    parser.add_argument("--branches", action="store_true", help="check those of the kernel")
    options = parser.parse_args(arguments)
    if options.branches:
        return check_branches()
    if options.document:
        print(page(TARGETS, load()), end="")
        return 0
    chosen = [module for module in TARGETS if not options.module or matches(module, options.module)]
    if not chosen:
        parser.error(f"no such module; choose from {', '.join(TARGETS)}")
    os.chdir(ROOT)
    if options.list:
        for module in chosen:
            for mutant in mutants_of(ROOT / module, ROOT):
                print(f"{mutant.line}: {mutant.identity}")
        return 0
    try:
        return report(chosen, options.jobs)
    except BrokenTestsError as broken:
        print(f"\n{broken}", file=sys.stderr)
        return 2


def matches(module: str, words: Sequence[str]) -> bool:
    """Return whether a module has one of these paths or names."""
    return any(word in (module, Path(module).stem) for word in words)


def report(modules: Sequence[str], jobs: int) -> int:
    """Try the mutants of some modules and print the result; return the exit code."""
    entries = load()
    listed = {identity for entry in entries for identity in entry.identities}
    alive: list[Mutant] = []
    print(HEADER, flush=True)
    for module in modules:
        began_s = time.monotonic()
        target = MutationTarget(ROOT / module, ROOT, TARGETS[module])
        mutants = mutants_of(target.path, ROOT)
        found = verdicts(target, mutants, jobs)
        survivors = [one for one, how in zip(mutants, found, strict=True) if how is SURVIVED]
        print(row(module, found, survivors, listed, time.monotonic() - began_s), flush=True)
        alive += survivors
    unexplained = [one for one in alive if one.identity not in listed]
    for mutant in unexplained:
        print(f"\nSURVIVED line {mutant.line}: {mutant.identity}")
    wrong = mistakes(entries, modules, (one.identity for one in alive))
    for mistake in wrong:
        print(f"\n{FILE.name}: {mistake}")
    return 1 if unexplained or wrong else 0


SURVIVED = MutantVerdict.SURVIVED


def row(
    module: str,
    found: Sequence[MutantVerdict],
    survivors: Sequence[Mutant],
    listed: set[Identity],
    spent_s: float,
) -> str:
    """Return the row of a module; the score leaves out the listed mutants."""
    count = Counter(found)
    explained = sum(one.identity in listed for one in survivors)
    left = len(survivors) - explained
    score = 1.0 - left / (len(found) - explained)
    killed, late = count[MutantVerdict.KILLED], count[MutantVerdict.TIMEOUT]
    figures = (len(found), killed, late, explained, left, f"{score:.1%}", f"{spent_s:.0f}")
    return ROW.format(module, *figures)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
