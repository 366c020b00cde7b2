"""`python -m tests.interop.environments`: install the virtual environment of each real client.

The versions are in `pins/`, one file per client, with all packages that the client imports. An
environment is made once for a file, in `build/interop`. The script prints what it did as it goes.
"""

import argparse
import fcntl
import hashlib
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final, NamedTuple

ROOT: Final = Path(__file__).resolve().parents[2]
PINS: Final = Path(__file__).with_name("pins")
FOLDER: Final = ROOT / "build" / "interop"
READY: Final = "ready"
INSTALL_S: Final = 600.0
LAST: Final = 3
PIP: Final = ("-m", "pip", "--disable-pip-version-check", "--no-input")


class NotInstalledError(Exception):
    """The client could not be installed; the message says why."""


class Environment(NamedTuple):
    """The interpreter that runs a client, and the versions of the client's packages."""

    python: Path
    versions: tuple[str, ...]


def clients() -> list[str]:
    """Return the clients that have an environment of their own."""
    return sorted(path.stem for path in PINS.glob("*.txt"))


def pins_of(client: str) -> tuple[str, ...]:
    """Return the pinned packages of a client."""
    lines = (PINS / f"{client}.txt").read_text(encoding="utf-8").splitlines()
    return tuple(line for line in lines if line and not line.startswith("#"))


def environment_of(client: str, folder: Path = FOLDER) -> Environment:
    """Return the environment of a client, installed if it has to be.

    Raises:
        NotInstalledError: It could not be installed.
    """
    pins = pins_of(client)
    place = folder / f"{client}-{digest(pins)}"
    found = Environment(place / "bin" / "python", pins)
    folder.mkdir(parents=True, exist_ok=True)
    with locked(folder / f"{client}.lock"):
        if not (place / READY).exists():
            install(place, pins)
    return found


def digest(pins: Sequence[str]) -> str:
    """Return a name for these versions under this Python."""
    text = "\n".join((sys.version, sys.prefix, *pins))
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def install(place: Path, pins: Sequence[str]) -> None:
    """Make an environment with exactly these packages."""
    shutil.rmtree(place, ignore_errors=True)
    run([sys.executable, "-m", "venv", str(place)])
    # Without dependencies: the pins list all, and nothing for a screen.
    run([str(place / "bin" / "python"), *PIP, "install", "--no-deps", *pins])
    (place / READY).write_text("\n".join(pins) + "\n", encoding="utf-8")


def run(words: Sequence[str]) -> None:
    """Run a step of the installation."""
    environment = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    try:
        done = subprocess.run(
            words, capture_output=True, text=True, timeout=INSTALL_S, check=False, env=environment
        )
    except subprocess.TimeoutExpired:
        raise NotInstalledError(f"{' '.join(words[1:])}: no end within {INSTALL_S:g} s") from None
    if done.returncode:
        last = " | ".join((done.stdout + done.stderr).strip().splitlines()[-LAST:])
        raise NotInstalledError(f"{' '.join(words[1:])}: {last}")


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Let one process at a time install a client."""
    with path.open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def main() -> int:
    """Install the clients that are named, by default all; say which ones were not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clients", nargs="*", default=clients(), metavar="CLIENT")
    parser.add_argument("--no-skips", action="store_true", help="return 1 if one is missing")
    options, code = parser.parse_args(), 0
    for client in options.clients:
        try:
            print(f"{client}: {environment_of(client).python}")
        except NotInstalledError as error:
            print(f"{client}: not installed: {error}", file=sys.stderr)
            code = 1
    return code if options.no_skips else 0


if __name__ == "__main__":
    sys.exit(main())
