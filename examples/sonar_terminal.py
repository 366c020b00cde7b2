"""Plot the eight sonars live in the terminal, until Ctrl-C.

    python examples/sonar_terminal.py

The queue holds one scan, so a slow terminal shows the newest scan.
"""

import argparse
import asyncio
import sys

import sidestep
from protocol.ring import CONE_DEG, SONARS
from protocol.wire.messages import SonarScan
from runtime.units import NS_PER_S

FARTHEST_M = 3.0
WIDTH = 40
HOME = "\x1b[H\x1b[J"


async def show(endpoint: str | None, scans: int | None) -> int:
    """Draw this many scans, or all; return how many were drawn."""
    drawn = 0
    clear = HOME if sys.stdout.isatty() else ""
    async with sidestep.connect(endpoint) as robot:
        stream = robot.sonar(size=1)
        async for scan in stream:
            print(f"{clear}{robot.name} at {scan.time_ns / NS_PER_S:.2f} s")
            print("\n".join(rows_of(scan)), flush=True)
            drawn += 1
            if drawn == scans:
                break
    return drawn


def rows_of(scan: SonarScan) -> list[str]:
    """Return one row for each sonar, the leftmost first."""
    return [row_of(scan, number) for number in reversed(range(SONARS))]


def row_of(scan: SonarScan, number: int) -> str:
    """Return a row such as `right 78.8 deg |######      | 0.45 m`.

    No echo differs from no measurement.
    """
    bearing_deg = (number - (SONARS - 1) / 2) * CONE_DEG
    side = "left" if bearing_deg > 0 else "right"
    label = f"{side:>5} {abs(bearing_deg):4.1f} deg"
    bit = 1 << number
    if not scan.valid & bit:
        return f"{label} |{'':{WIDTH}}| not measured"
    if not scan.echo & bit:
        return f"{label} |{'.' * WIDTH}| no echo"
    range_m = scan.range_mm[number] / 1000
    marks = round(min(range_m, FARTHEST_M) / FARTHEST_M * WIDTH)
    return f"{label} |{'#' * marks:{WIDTH}}| {range_m:.2f} m"


def main(argv: list[str] | None = None) -> int:
    """Draw scans until stopped."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--connect", metavar="ENDPOINT")
    parser.add_argument("--scans", type=int, metavar="N", help="stop after N scans")
    given = parser.parse_args(argv)
    asyncio.run(show(given.connect, given.scans))
    return 0


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
    except (sidestep.UserError, sidestep.RemoteError) as error:
        sys.exit(f"sonar_terminal: {error}")
