"""`python -m tests.interop.environments`: install the packages of each real client.

The versions are in `pins/`, one file per client, with all packages that the client imports:
NAME==VERSION in a virtual environment of its own, or NAME@VERSION of npm.
"""

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path
from shutil import which
from typing import Final, NamedTuple

from checks.built import BuildError, environment, node_modules

PINS: Final = Path(__file__).with_name("pins")


def clients() -> list[str]:
    """Return the clients that have an environment of their own."""
    return sorted(path.stem for path in PINS.glob("*.txt"))


def pins_of(client: str) -> tuple[str, ...]:
    """Return the pinned packages of a client."""
    lines = (PINS / f"{client}.txt").read_text(encoding="utf-8").splitlines()
    return tuple(line for line in lines if line and not line.startswith("#"))


class Installed(NamedTuple):
    """The Python that runs the script of a client, and the variables that it needs."""

    python: Path
    variables: Mapping[str, str]


def is_of_npm(client: str) -> bool:
    """Return whether a client has packages of npm."""
    return any("@" in pin for pin in pins_of(client))


def is_expected(client: str) -> bool:
    """Return whether a client can be installed here: npm is no part of what the gate needs."""
    return not is_of_npm(client) or which("npm") is not None


def installed(client: str) -> Installed:
    """Return what runs a client; raise BuildError if its packages cannot be installed."""
    if is_of_npm(client):
        modules = node_modules(client, pins_of(client))
        return Installed(Path(sys.executable), {"NODE_PATH": str(modules)})
    return Installed(environment(client, pins_of(client)), {})


def main() -> int:
    """Install the clients that are named, by default all; say which ones were not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clients", nargs="*", default=clients(), metavar="CLIENT")
    parser.add_argument(
        "--no-skips",
        action="store_true",
        help="return 1 if one is missing that can be installed here",
    )
    options, code = parser.parse_args(), 0
    for client in options.clients:
        try:
            print(f"{client}: {' '.join(map(str, installed(client)))}")
        except BuildError as error:
            print(f"{client}: not installed: {error}", file=sys.stderr)
            code |= is_expected(client)
    return code if options.no_skips else 0


if __name__ == "__main__":
    sys.exit(main())
