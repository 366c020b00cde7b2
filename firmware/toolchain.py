"""The tools that the build needs, and the source of MicroPython.

Both are packages of Debian. The source may be of a newer release than the tools. So apt fetches it
with a separate configuration, from the mirror and with the keys of this machine.
"""

import re
import shutil
import subprocess
import tarfile
from collections.abc import Iterable, Sequence
from hashlib import sha256
from pathlib import Path
from typing import Final

from firmware.image import OUTPUT
from runtime.errors import UserError

TOOLS: Final = {
    "arm-none-eabi-gcc": "gcc-arm-none-eabi",
    "arm-none-eabi-ld": "binutils-arm-none-eabi",
    "gcc": "gcc",
    "make": "make",
    "python3": "python3",
}
"""Packages of Debian by the command that they contain."""
HEADERS: Final = {
    Path("/usr/include/newlib/stdint.h"): "libnewlib-dev",
    Path("/usr/include/stdio.h"): "libc6-dev",
}
"""Packages of Debian by a header that they contain; gcc only recommends the last one."""
SUITE: Final = "trixie"
PACKAGE: Final = "micropython"
VERSION: Final = "1.25.0"
TARBALL: Final = f"{PACKAGE}_{VERSION}+ds.orig.tar.xz"
TARBALL_SHA256: Final = "7b25be99a502f070b2de81dafc08da7051d992325d6e67daa9045a918fffdbea"
KEYRING: Final = Path("/usr/share/keyrings/debian-archive-keyring.gpg")
SOURCES: Final = Path("/etc/apt")
MIRROR: Final = re.compile(r"https?://\S+/debian/?(?=\s)")
TIMEOUT_S: Final = 300.0


def missing_packages() -> list[str]:
    """Return the packages of tools and headers that this machine lacks."""
    missing = [package for tool, package in TOOLS.items() if shutil.which(tool) is None]
    return missing + [package for header, package in HEADERS.items() if not header.exists()]


def check_tools() -> None:
    """Raise UserError naming all packages that are missing."""
    missing = missing_packages()
    if missing:
        raise UserError(f"the firmware needs packages that are not installed: {advice(missing)}")


def advice(packages: Iterable[str]) -> str:
    """Return the command that installs packages."""
    return f"apt install --no-install-recommends {' '.join(packages)}"


def source_tree() -> Path:
    """Return the source of MicroPython, after fetching and unpacking it if necessary."""
    tree = OUTPUT / f"{PACKAGE}-{VERSION}"
    ready = tree / "ready"
    if not ready.exists():
        tarball = OUTPUT / "source" / TARBALL
        if not tarball.exists():
            fetch(tarball)
        check(tarball)
        shutil.rmtree(tree, ignore_errors=True)
        with tarfile.open(tarball) as archive:
            # An attribute, not an argument: Python before 3.11.4, as in Debian 12, has no filters.
            archive.extraction_filter = getattr(tarfile, "data_filter", None)
            archive.extractall(OUTPUT)
        # The makefiles test for a file of a folder that Debian leaves out.
        (tree / "lib/micropython-lib").mkdir(exist_ok=True)
        (tree / "lib/micropython-lib/README.md").touch()
        ready.touch()
    return tree


def check(tarball: Path) -> None:
    """Raise UserError unless the source is the one that the firmware was written for."""
    found = sha256(tarball.read_bytes()).hexdigest()
    if found != TARBALL_SHA256:
        raise UserError(f"{tarball} has sha256 {found}, not {TARBALL_SHA256}: remove it")


def fetch(tarball: Path) -> None:
    """Fetch the source package by apt, with an isolated configuration."""
    by_hand = f"put {TARBALL} of Debian {SUITE} into {tarball.parent}"
    if shutil.which("apt-get") is None:
        raise UserError(f"the source of MicroPython needs apt-get: {by_hand}")
    folder = OUTPUT / "apt"
    for name in ("lists/partial", "cache/archives/partial", "empty"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    tarball.parent.mkdir(parents=True, exist_ok=True)
    sources = folder / "micropython.sources"
    sources.write_text(source_of(mirror(), KEYRING), encoding="utf-8")
    for action in (["update"], ["source", "--download-only", PACKAGE]):
        command = ["apt-get", *isolated(folder, sources), *action]
        done = subprocess.run(
            command, cwd=tarball.parent, capture_output=True, text=True, timeout=TIMEOUT_S
        )
        if done.returncode != 0 or (action[0] == "source" and not tarball.exists()):
            cause = done.stderr.strip().splitlines()[-1:] or ["no cause given"]
            raise UserError(f"apt cannot fetch the source of MicroPython ({cause[0]}): {by_hand}")


def isolated(folder: Path, sources: Path) -> Sequence[str]:
    """Return the options with which apt does not use the configuration of this machine."""
    options = {
        "Dir::Etc::SourceList": sources,
        "Dir::Etc::SourceParts": folder / "empty",
        "Dir::State::Lists": folder / "lists",
        "Dir::Cache": folder / "cache",
        "APT::Sandbox::User": "",
        "Debug::NoLocking": "1",
    }
    return [part for name, value in options.items() for part in ("-o", f"{name}={value}")]


def source_of(uri: str, keyring: Path) -> str:
    """Return the entry of the source package's repository."""
    return f"Types: deb-src\nURIs: {uri}\nSuites: {SUITE}\nComponents: main\nSigned-By: {keyring}\n"


def mirror(folder: Path = SOURCES) -> str:
    """Return the mirror of Debian that this machine uses."""
    files = [folder / "sources.list", *sorted((folder / "sources.list.d").glob("*"))]
    for file in files:
        if file.is_file():
            text = file.read_text(encoding="utf-8", errors="replace") + "\n"
            lines = [line for line in text.splitlines() if not line.lstrip().startswith("#")]
            found = MIRROR.search("\n".join([*lines, ""]))
            if found is not None:
                return found[0]
    raise UserError(
        f"no mirror of Debian in {folder}: add one, or put {TARBALL} into build/firmware/source"
    )


def compiler(tree: Path) -> Path:
    """Return MicroPython's cross compiler, after building it if necessary."""
    program = tree / "mpy-cross" / "build" / "mpy-cross"
    if not program.exists():
        run(["make", "-C", str(tree / "mpy-cross")])
    return program


def run(command: Sequence[str]) -> None:
    """Run a step of the build; raise UserError with the end of its output if it fails."""
    done = subprocess.run(
        [*command, "-j2"], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    if done.returncode:
        lines = [line for line in done.stdout.splitlines() if "rror" in line or "overflow" in line]
        what = lines[0] if lines else done.stdout[-300:]
        raise UserError(f"{' '.join(command[:3])} failed: {what}")
