"""`python -m checks.hashes`: write the requirements of the images, with all hashes.

The versions are those of constraints.txt, and what is wanted is in pyproject.toml. Of each package
the files are listed that pip chooses for Linux on both machines with each Python; pip then refuses
every other file, and every package that is not listed. The hashes are those of the index that pip
is configured for.
"""

import json
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Final, NamedTuple

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT: Final = Path(__file__).resolve().parents[1]
FOLDER: Final = ROOT / "docker"
PYTHONS: Final = ("3.11", "3.12", "3.13")
MACHINES: Final = ("x86_64", "aarch64")
GLIBC: Final = 36
"""Newest C library that a file may need: that of Debian 12. Newer systems take these files, too."""
RUNTIME: Final = "runtime"
LISTS: Final[Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]]] = {
    RUNTIME: (("web", "keys"), ()),
    "build": ((), ("hatchling", "mypy", "setuptools")),
    "tests": (("dev",), ("hatchling", "editables")),
}
"""The extras of the project, and the tools, that each list has; all begin with the first list."""
HEAD: Final = "# `make hashes` writes this, from constraints.txt and pyproject.toml."


class PinnedFile(NamedTuple):
    """What pip chose of one package for one Python and machine."""

    version: str
    sha256: str
    requires: tuple[Requirement, ...]


def chosen(python: str, machine: str) -> dict[str, PinnedFile]:
    """Return the file of each package of constraints.txt, by its name, as pip chooses it."""
    tags = [f"manylinux_2_{minor}_{machine}" for minor in range(GLIBC, 4, -1)]
    tags += [f"{old}_{machine}" for old in ("manylinux2014", "manylinux2010", "manylinux1")]
    platforms = [word for tag in tags for word in ("--platform", tag)]
    with tempfile.TemporaryDirectory() as folder:
        words = (
            *("--quiet", "--disable-pip-version-check", "--no-input", "install", "--dry-run"),
            *("--ignore-installed", "--target", folder, "--no-deps", "--only-binary=:all:"),
            *("--python-version", python, *platforms, "--report", f"{folder}/report.json"),
            *("-r", str(ROOT / "constraints.txt")),
        )
        subprocess.run([sys.executable, "-m", "pip", *words], check=True)
        report = json.loads(Path(folder, "report.json").read_bytes())
    return {
        canonicalize_name(one["metadata"]["name"]): PinnedFile(
            one["metadata"]["version"],
            one["download_info"]["archive_info"]["hashes"]["sha256"],
            tuple(map(Requirement, one["metadata"].get("requires_dist", ()))),
        )
        for one in report["install"]
    }


def needed(
    wanted: Iterable[str],
    requires: Mapping[str, Iterable[Requirement]],
    environment: Mapping[str, str],
) -> set[str]:
    """Return the names of all packages that some need, themselves included, in an environment."""

    def applying(name: str, extra: str) -> Iterator[Requirement]:
        for one in requires[name]:
            if one.marker is None or one.marker.evaluate({**environment, "extra": extra}):
                yield one

    found: set[tuple[str, str]] = set()
    waiting = [Requirement(text) for text in wanted]
    while waiting:
        one = waiting.pop()
        name = canonicalize_name(one.name)
        for extra in {"", *one.extras}:
            if (name, extra) not in found:
                found.add((name, extra))
                waiting += applying(name, extra)
    return {name for name, _ in found}


def wanted_in(name: str) -> list[str]:
    """Return the requirements of a list: those of the project, of its extras, and the tools."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras, tools = LISTS[name]
    chosen_extras = [project["optional-dependencies"][extra] for extra in extras]
    return [*project["dependencies"], *(one for extra in chosen_extras for one in extra), *tools]


def main() -> int:
    """Ask pip for each Python and machine, and write the lists."""
    names: dict[str, set[str]] = {name: set() for name in LISTS}
    lines: dict[str, set[str]] = {}
    versions: dict[str, str] = {}
    for python in PYTHONS:
        for machine in MACHINES:
            print(f"Python {python} on {machine}")
            files = chosen(python, machine)
            requires = {package: file.requires for package, file in files.items()}
            environment = {
                "python_version": python,
                "python_full_version": f"{python}.0",
                "platform_machine": machine,
                "platform_system": "Linux",
                "sys_platform": "linux",
                "os_name": "posix",
                "implementation_name": "cpython",
                "platform_python_implementation": "CPython",
            }
            for name, packages in names.items():
                packages |= needed(wanted_in(name), requires, environment)
            for package, file in files.items():
                lines.setdefault(package, set()).add(f"--hash=sha256:{file.sha256}")
                versions[package] = file.version
    for name, packages in names.items():
        begin, own = [HEAD], packages
        if name != RUNTIME:
            begin, own = [HEAD, f"-r {RUNTIME}.txt"], packages - names[RUNTIME]
        entries = (
            " \\\n    ".join((f"{package}=={versions[package]}", *sorted(lines[package])))
            for package in sorted(own)
        )
        (FOLDER / f"{name}.txt").write_text("\n".join((*begin, *entries, "")))
    return 0


if __name__ == "__main__":
    sys.exit(main())
