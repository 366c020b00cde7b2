"""`python -m checks.same_bits`: run random trials in every variant and compare the digests.

By default the variants of the processor; `--libraries` adds all available Pythons and library
versions, `--compiled` the modules compiled with mypyc, `--python` other interpreters (one of
another C library, for instance). Exits with 1 if a digest differs or a variant cannot run.

`--page FILE` writes a page, and the same as JSON beside it, after each variant; variants that a
former run has measured stay there. `--control COMMIT` runs an older commit instead, and
`--functions` compares functions of the libraries instead of trials; there differences are expected.
"""

import argparse
import os
import subprocess
import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from pathlib import Path

from checks.harness import figures
from checks.same_bits.functions import VALUES, values_of
from checks.same_bits.record import Functions, VariantRow, read, write
from checks.same_bits.trials import TrialDigest, result_of
from checks.same_bits.variants import ROOT, Variant, compiled, of_libraries, of_processors, unpack

SECONDS_PER_TRIAL = 30.0
FUNCTIONS_S = 300.0


def main(argv: Sequence[str] | None = None) -> int:
    """Compare every variant with this Python in its usual environment; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m checks.same_bits", description=__doc__)
    parser.add_argument("--trials", type=int, default=1000, metavar="N")
    parser.add_argument("--libraries", action="store_true", help="all Pythons and libraries")
    parser.add_argument("--compiled", action="store_true", help="the compiled modules, too")
    parser.add_argument("--python", nargs="*", default=[], metavar="FILE", help="further Pythons")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="variants at a time")
    parser.add_argument("--only", default="", metavar="TEXT", help="variants whose name has TEXT")
    parser.add_argument("--control", metavar="COMMIT", help="run an older commit")
    parser.add_argument("--functions", action="store_true", help="compare libraries' functions")
    parser.add_argument("--page", type=Path, metavar="FILE", help="write the results to FILE")
    parser.add_argument("--folder", type=Path, default=ROOT / "build" / "same-bits")
    options = parser.parse_args(argv)
    root = unpack(options.control, options.folder / "older") if options.control else ROOT
    variants = [one for one in variants_of(options) if options.only in one.name]
    if options.functions:
        return compare_functions(variants, options.page)
    equal = True
    with ThreadPoolExecutor(options.jobs) as pool:
        usual = pool.submit(run, Variant("usual", sys.executable), options.trials, root)
        found = pool.map(lambda one: attempt(one, options.trials, root), variants)
        ends = Counter(result.outcome for result in usual.result())
        print(f"{ends.total()} trials in the usual environment; ends: {described(ends)}")
        for variant, results in zip(variants, found, strict=True):
            differing = compared(variant, usual.result(), results)
            equal = equal and differing == []
            if options.page and differing is not None:
                keep(options, variant, differing, ends)
    return 0 if equal else 1


def variants_of(options: argparse.Namespace) -> list[Variant]:
    """Return the variants that the options ask for."""
    variants = [*of_processors(sys.executable), *(Variant(one, one) for one in options.python)]
    if options.compiled:
        variants.append(compiled(options.folder / "compiled"))
    if options.libraries:
        variants += of_libraries(options.folder)
    return variants


def run(variant: Variant, trials: int, root: Path = ROOT) -> list[TrialDigest]:
    """Run the trials in a variant; raise RuntimeError with its output if it fails."""
    words = ("checks.same_bits.trials", str(trials))
    return [result_of(line) for line in output(variant, words, SECONDS_PER_TRIAL * trials, root)]


def compare_functions(variants: Sequence[Variant], page: Path | None) -> int:
    """Count the values of library functions that differ in each variant; return the exit code."""
    words = ("checks.same_bits.functions",)
    usual = output(Variant("usual", sys.executable), words, FUNCTIONS_S)
    for variant in variants:
        lines = output(variant, words, FUNCTIONS_S)
        differing = {}
        for one, other in zip(map(values_of, usual), map(values_of, lines), strict=True):
            differing[one[0]] = sum(a != b for a, b in zip(one[1], other[1], strict=True))
        print(f"{variant.name}: {differing}")
        if page:
            record = read(page.with_suffix(".json"))
            record.add_functions(Functions(variant.name, VALUES, differing))
            write(record, page)
    return 0


def output(
    variant: Variant, words: Sequence[str], timeout_s: float, root: Path = ROOT
) -> list[str]:
    """Return the lines of a module in a variant; raise RuntimeError with its output if it fails."""
    child = subprocess.run(
        # With -P the search path alone decides whether a module is a compiled one.
        [variant.python, "-P", "-m", *words],
        cwd=root,
        env={**os.environ, "PYTHONPATH": str(root), **variant.environment},
        capture_output=True,
        text=True,
        timeout=timeout_s,
        check=False,
    )
    if child.returncode:
        raise RuntimeError(f"{variant.name}: {child.stderr.strip()[-2000:]}")
    return child.stdout.splitlines()


def attempt(variant: Variant, trials: int, root: Path = ROOT) -> list[TrialDigest] | str:
    """Run the trials in a variant; return an error message if it cannot."""
    try:
        return run(variant, trials, root)
    except (RuntimeError, OSError, subprocess.TimeoutExpired) as error:
        return str(error)


def compared(
    variant: Variant, usual: Sequence[TrialDigest], found: Sequence[TrialDigest] | str
) -> list[str] | None:
    """Print and return the trials whose digests differ in a variant; None if it could not run."""
    if isinstance(found, str):
        print(f"cannot run: {found}", flush=True)
        return None
    differing = differences(usual, found)
    print(f"{len(differing)} of {len(usual)} differ: {variant.name}", flush=True)
    for name in differing[:5]:
        print(f"    {name}")
    return differing


def differences(usual: Sequence[TrialDigest], found: Sequence[TrialDigest]) -> list[str]:
    """Return the settings of trials whose digests differ or are missing."""
    digests = {result.number: result.digest for result in found}
    return [one.settings for one in usual if digests.get(one.number) != one.digest]


def keep(
    options: argparse.Namespace, variant: Variant, differing: list[str], ends: Counter[str]
) -> None:
    """Add the result of a variant to the page and to the JSON beside it."""
    record = read(options.page.with_suffix(".json"))
    if not options.control:
        record.machine = ", ".join(
            f"{k} {v}" for k, v in figures.describe_machine(figures.machine_load()).items()
        )
        record.ends = described(ends)
    record.add(
        VariantRow(
            variant=variant.name,
            trials=ends.total(),
            differing=differing,
            commit=commit(options.control or "HEAD"),
            date=f"{datetime.now(UTC):%Y-%m-%d}",
            control=bool(options.control),
        )
    )
    write(record, options.page)


def commit(name: str) -> str:
    """Return the short hash of a commit."""
    words = ("git", "rev-parse", "--short=8", name)
    return subprocess.run(
        words, cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.strip()


def described(ends: Counter[str]) -> str:
    """Return how many trials ended in which way."""
    return ", ".join(f"{count} {outcome}" for outcome, count in ends.most_common())


if __name__ == "__main__":
    sys.exit(main())
