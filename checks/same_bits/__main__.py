"""`python -m checks.same_bits`: run random trials in every variant and compare the digests.

By default the variants of the processor; `--libraries` adds all available Pythons and library
versions, `--compiled` the modules compiled with mypyc, `--python` other interpreters (one of
another C library, for instance). Exits with 1 if a digest differs or a variant cannot run.

`--page FILE` writes a page, and the same as JSON beside it, after each variant; variants that a
former run has measured stay there. `--control COMMIT` runs an older commit instead, with the trials
of this one, and `--functions` compares functions of the libraries instead of trials; there
differences are expected.

The lowest supported libraries are those named in pyproject.toml, the newest those of the package
index. Each pair of a Python and a set of libraries has a virtual environment of its own.
"""

import argparse
import os
import shutil
import subprocess
import sys
import tarfile
import tomllib
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime
from io import BytesIO
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

import msgspec

from checks.built import BuildError, install_compiled, python_named
from checks.harness import figures
from checks.same_bits.trials import VALUES, TrialDigest, result_of, values_of

ROOT: Final = Path(__file__).resolve().parents[2]
LIBRARIES: Final = ("numpy", "pymunk", "msgspec", "fastcrc")
"""Dependencies of the project that a trial imports."""

PYTHONS: Final = ("python3.11", "python3.12", "python3.13")

TUNABLES: Final = "GLIBC_TUNABLES"
PLAIN_C: Final = "glibc.cpu.hwcaps=-FMA,-FMA4,-AVX2,-AVX2_Usable,-FMA_Usable"
PLAINER_C: Final = f"{PLAIN_C},-AVX,-SSE4_1,-SSE4_2,-AVX512F,-AVX512VL,-AVX512DQ,-AVX512BW"
NO_FEATURES: Final = {"NPY_DISABLE_CPU_FEATURES": "X86_V4 X86_V3"}
NO_FEATURES_OF_2_0: Final = {
    "NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3 AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL"
}
"""The names of the features before numpy 2.4."""


class Variant(NamedTuple):
    """A name, the Python that runs the trials, and its additional environment variables."""

    name: str
    python: str
    environment: Mapping[str, str] = MappingProxyType({})


def of_processors(python: str) -> list[Variant]:
    """Return variants of a Python in which libraries do not use some processor features."""
    return [
        Variant("C library without AVX2 and FMA", python, {TUNABLES: PLAIN_C}),
        Variant("C library without AVX, AVX-512 and SSE4", python, {TUNABLES: PLAINER_C}),
        Variant("numpy without AVX2, FMA3 and AVX-512", python, _numpy_plain(python)),
        Variant("BLAS for an old processor", python, {"OPENBLAS_CORETYPE": "Prescott"}),
        Variant("BLAS for Haswell", python, {"OPENBLAS_CORETYPE": "Haswell"}),
        Variant(
            "all of these, and another hash of strings",
            python,
            {
                TUNABLES: PLAINER_C,
                **_numpy_plain(python),
                "OPENBLAS_CORETYPE": "Prescott",
                "PYTHONHASHSEED": "4711",
            },
        ),
    ]


def _numpy_plain(python: str) -> dict[str, str]:
    """Return the variable that switches numpy's instructions off; a wrong name is an error."""
    code = "import numpy; numpy.zeros(1)"
    ran = subprocess.run(
        [python, "-W", "error", "-c", code],
        env={**os.environ, **NO_FEATURES},
        capture_output=True,
        check=False,
    )
    return NO_FEATURES_OF_2_0 if ran.returncode else NO_FEATURES


def of_libraries(folder: Path) -> list[Variant]:
    """Return every Python found, with its lowest and with its newest available libraries."""
    variants = []
    for name in PYTHONS:
        python = python_named(name)
        for kind in ("lowest", "newest"):
            if python is None:
                print(f"{name}: not found", file=sys.stderr)
            elif made := _environment(python, folder / f"{name}-{kind}", kind == "lowest"):
                variants.append(Variant(f"{name}, {kind} libraries: {_libraries(made)}", made))
            else:
                print(f"{name}: its {kind} libraries cannot be installed", file=sys.stderr)
    return variants


def compiled(folder: Path) -> Variant:
    """Return this Python with the modules that mypyc compiles; raise RuntimeError without them.

    The folder goes before the checkout on the search path.
    """
    try:
        install_compiled(folder)
    except BuildError as error:
        raise RuntimeError(f"cannot compile: {error}") from None
    return Variant("compiled modules", sys.executable, {"PYTHONPATH": f"{folder}:{ROOT}"})


def requirements(lowest: bool) -> list[str]:
    """Return the requirements of a trial for pip."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    found = []
    for requirement in project["dependencies"]:
        name, _, version = requirement.partition(">=")
        if name in LIBRARIES:
            found.append(f"{name}=={version}.*" if lowest else name)
    return found


def _environment(python: str, folder: Path, lowest: bool) -> str | None:
    """Create a virtual environment; return its Python, None if a library is not available."""
    made = folder / "bin" / "python"
    wanted = requirements(lowest)
    ready = folder / "ready"
    if not ready.exists() or ready.read_text("utf-8") != "\n".join(wanted):
        steps = (
            [python, "-m", "venv", "--clear", str(folder)],
            [str(made), "-m", "pip", "install", "-q", "--only-binary=:all:", *wanted],
        )
        if any(subprocess.run(step, capture_output=True, check=False).returncode for step in steps):
            return None
        ready.write_text("\n".join(wanted), "utf-8")
    return str(made)


def _libraries(python: str) -> str:
    code = (
        "from importlib.metadata import version\n"
        f"print(', '.join(f'{{one}} {{version(one)}}' for one in {LIBRARIES[:2]!r}))"
    )
    return subprocess.run(
        [python, "-c", code], capture_output=True, text=True, check=True
    ).stdout.strip()


BROUGHT: Final = (
    "checks/same_bits/__init__.py",
    "checks/same_bits/trials.py",
    "plant/model/draws.py",
)
"""Files that the trials need and an older commit lacks. Draws only choose the trials there."""


def unpack(commit: str, folder: Path, brought: Sequence[str] = BROUGHT) -> Path:
    """Unpack a commit into a folder, with files of this one that it lacks; return the folder.

    Raises subprocess.CalledProcessError for an unknown commit.
    """
    archive = subprocess.run(["git", "archive", commit], cwd=ROOT, capture_output=True, check=True)
    shutil.rmtree(folder, ignore_errors=True)
    with tarfile.open(fileobj=BytesIO(archive.stdout)) as tar:
        # An attribute, not an argument: Python before 3.11.4, as in Debian 12, has no filters.
        tar.extraction_filter = getattr(tarfile, "data_filter", None)
        tar.extractall(folder)
    for name in brought:
        target = folder / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if not target.exists():
            shutil.copyfile(ROOT / name, target)
    return folder


EXAMPLES: Final = 3
HEAD: Final = "| variant | trials | digests that differ | commit | date |\n|---|---|---|---|---|"


class VariantRow(msgspec.Struct, frozen=True):
    """One variant: number of trials, and those that differ from the usual environment."""

    variant: str
    trials: int
    differing: list[str]
    commit: str
    date: str
    control: bool = False
    """Whether the commit is an older one, whose digests are expected to differ."""


class Functions(msgspec.Struct, frozen=True):
    """Number of values that differ in one variant, for each function of a library."""

    variant: str
    values: int
    differing: dict[str, int]


class BitsRecord(msgspec.Struct):
    """All variants compared so far, and where."""

    machine: str = ""
    ends: str = ""
    """How the trials ended, with their numbers."""
    rows: list[VariantRow] = []
    functions: list[Functions] = []
    notes: list[str] = []
    """Remarks written by hand in the JSON file."""

    def add(self, row: VariantRow) -> None:
        """Add a row; it replaces the one of the same variant."""
        key = (row.variant, row.control)
        self.rows = [one for one in self.rows if (one.variant, one.control) != key]
        self.rows.append(row)

    def add_functions(self, found: Functions) -> None:
        """Add the result of a variant; it replaces an older one."""
        self.functions = [one for one in self.functions if one.variant != found.variant]
        self.functions.append(found)


def read(path: Path) -> BitsRecord:
    """Return the record in a file, an empty one if there is none."""
    return (
        msgspec.json.decode(path.read_bytes(), type=BitsRecord) if path.exists() else BitsRecord()
    )


def write(record: BitsRecord, page: Path) -> None:
    """Write the page, and the record as JSON beside it."""
    text = msgspec.json.format(msgspec.json.encode(record), indent=1)
    page.with_suffix(".json").write_bytes(text + b"\n")
    page.write_text(page_of(record), encoding="utf-8")


def page_of(record: BitsRecord) -> str:
    """Return the page of evidence."""
    rows = [row for row in record.rows if not row.control]
    control = [row for row in record.rows if row.control]
    compared, differing = sum(row.trials for row in rows), sum(len(row.differing) for row in rows)
    parts = [
        "# Same bits",
        "Made by `python -m checks.same_bits --libraries --compiled --page"
        " docs/evidence/same-bits.md`.\nEach variant runs the same random trials of the corpus:"
        " any family, navigator, side, noise level, seed and start\ntime, at most 20 simulated"
        " seconds. The digest of a trial covers every bit of its trajectory.\nThe reference is the"
        f" usual environment on the same machine.\n{differing} of {compared} digests differ.",
        f"Machine: {record.machine}. Ends of the trials: {record.ends}.",
        table(rows),
        *record.notes,
    ]
    if control:
        parts += [
            "## Control",
            "The same comparison at an older commit, which used the C library's functions, numpy's"
            " generator and pymunk's\nsolver. Short trials hide most differences of a last bit: a"
            " step is a thousand times smaller than the position\nit is added to.",
            table(control),
            *examples(control),
        ]
    if record.functions:
        parts += [
            "## Functions of libraries",
            f"The table counts the values that differ from those in the usual environment, of"
            f" {record.functions[0].values} values of each function.\nNo result of a trial depends"
            " on them.",
            table_of_functions(record.functions),
        ]
    return "\n\n".join(parts) + "\n"


def table_of_functions(found: Sequence[Functions]) -> str:
    """Return the table of differing values, one column for each function."""
    names = list(found[0].differing)
    head = f"| variant | {' | '.join(names)} |\n|---|{'---|' * len(names)}"
    lines = (
        f"| {one.variant} | {' | '.join(str(one.differing[name]) for name in names)} |"
        for one in found
    )
    return "\n".join([head, *lines])


def table(rows: Iterable[VariantRow]) -> str:
    """Return the table of rows."""
    lines = (
        f"| {row.variant} | {row.trials} | {len(row.differing)} | `{row.commit}` | {row.date} |"
        for row in rows
    )
    return "\n".join([HEAD, *lines])


def examples(rows: Sequence[VariantRow]) -> list[str]:
    """Return a paragraph with some trials that differ, if there are any."""
    found = dict.fromkeys(name for row in rows for name in row.differing[:EXAMPLES])
    names = ", ".join(f"`{name}`" for name in [*found][:EXAMPLES])
    return [f"Some that differ: {names}."] if names else []


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
    words = ("checks.same_bits.trials",)
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
