"""`python -m verification.same_bits`: run random trials in every variant and compare the digests.

By default the variants of the processor; `--libraries` adds all Pythons and library versions that
can be had, `--python` other interpreters (one of another C library, for instance). Exits with 1 if
a digest differs or a variant cannot run.
"""

import argparse
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from verification.same_bits.trials import Result, result_of
from verification.same_bits.variants import ROOT, Variant, of_libraries, of_processors

SECONDS_PER_TRIAL = 30.0


def main(argv: Sequence[str] | None = None) -> int:
    """Compare every variant with this Python in its usual environment; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m verification.same_bits", description=__doc__)
    parser.add_argument("--trials", type=int, default=1000, metavar="N")
    parser.add_argument("--libraries", action="store_true", help="all Pythons and libraries")
    parser.add_argument("--python", nargs="*", default=[], metavar="FILE", help="further Pythons")
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "same-bits")
    options = parser.parse_args(argv)
    variants = [*of_processors(sys.executable), *(Variant(one, one) for one in options.python)]
    if options.libraries:
        variants += of_libraries(options.folder)
    usual = run(Variant("usual", sys.executable), options.trials)
    ends = ", ".join(sorted({result.outcome for result in usual}))
    print(f"{len(usual)} trials in the usual environment; ends: {ends}")
    return 1 if sum([not compared(variant, usual) for variant in variants]) else 0


def run(variant: Variant, trials: int) -> list[Result]:
    """Run the trials in a variant; raise RuntimeError with its words if it cannot."""
    child = subprocess.run(
        [variant.python, "-m", "verification.same_bits.trials", str(trials)],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT), **variant.environment},
        capture_output=True,
        text=True,
        timeout=SECONDS_PER_TRIAL * trials,
        check=False,
    )
    if child.returncode:
        raise RuntimeError(f"{variant.name}: {child.stderr.strip()[-2000:]}")
    return [result_of(line) for line in child.stdout.splitlines()]


def compared(variant: Variant, usual: Sequence[Result]) -> bool:
    """Print how many digests differ in a variant, and which; return whether none does."""
    try:
        found = run(variant, len(usual))
    except (RuntimeError, OSError, subprocess.TimeoutExpired) as error:
        print(f"cannot run: {error}")
        return False
    differing = differences(usual, found)
    print(f"{len(differing)} of {len(usual)} differ: {variant.name}", flush=True)
    for name in differing[:5]:
        print(f"    {name}")
    return not differing


def differences(usual: Sequence[Result], found: Sequence[Result]) -> list[str]:
    """Return the settings of trials whose digests differ or are missing."""
    digests = {result.number: result.digest for result in found}
    return [one.settings for one in usual if digests.get(one.number) != one.digest]


if __name__ == "__main__":
    sys.exit(main())
