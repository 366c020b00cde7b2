"""`python -m tests.interop.environments`: install the virtual environment of each real client.

The versions are in `pins/`, one file per client, with all packages that the client imports.
"""

import argparse
import sys
from pathlib import Path
from typing import Final

from checks.built import BuildError, environment

PINS: Final = Path(__file__).with_name("pins")


def clients() -> list[str]:
    """Return the clients that have an environment of their own."""
    return sorted(path.stem for path in PINS.glob("*.txt"))


def pins_of(client: str) -> tuple[str, ...]:
    """Return the pinned packages of a client."""
    lines = (PINS / f"{client}.txt").read_text(encoding="utf-8").splitlines()
    return tuple(line for line in lines if line and not line.startswith("#"))


def python_of(client: str) -> Path:
    """Return the Python with the packages of a client; raise BuildError if they are not there."""
    return environment(client, pins_of(client))


def main() -> int:
    """Install the clients that are named, by default all; say which ones were not."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clients", nargs="*", default=clients(), metavar="CLIENT")
    parser.add_argument("--no-skips", action="store_true", help="return 1 if one is missing")
    options, code = parser.parse_args(), 0
    for client in options.clients:
        try:
            print(f"{client}: {python_of(client)}")
        except BuildError as error:
            print(f"{client}: not installed: {error}", file=sys.stderr)
            code = 1
    return code if options.no_skips else 0


if __name__ == "__main__":
    sys.exit(main())
