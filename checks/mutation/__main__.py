"""`python -m checks.mutation`: try all mutants, print the scores and the survivors.

The exit code is 1 if a mutant survives that is not listed as equivalent, or if the list is wrong.
It is 2 if the tests fail without any mutant.
"""

import argparse
import os
import sys
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from checks.mutation.kernel import TARGETS
from checks.mutation.mutants import FILE, Identity, Mutant, load, mistakes, mutants_of, page
from checks.mutation.runner import BrokenTestsError, MutantVerdict, MutationTarget, verdicts

ROOT = Path(__file__).resolve().parents[2]
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
    options = parser.parse_args(arguments)
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
