"""Drive a mission round after round, and print each waypoint the robot drives to.

    python examples/patrol.py 2.0,1.0 4.0,1.0 4.0,3.0 --rounds 3
    python examples/patrol.py patrol.toml

Ctrl-C pauses the mission: the robot stops.
"""

import argparse
import asyncio
import sys

import sidestep
from sidestep import Mission, Waypoint


async def patrol(endpoint: str | None, mission: Mission | str, rounds: int) -> bool:
    """Return whether every waypoint of every round was reached."""
    async with sidestep.connect(endpoint) as robot:
        sidestep.agreed(await robot.mission.upload(mission))
        printing = asyncio.create_task(print_events(robot))
        try:
            for number in range(1, rounds + 1):
                print(f"round {number} of {rounds}")
                outcome = await robot.mission.run(item=1)
                print(outcome.text)
                if not outcome.ok:
                    return False
        finally:
            printing.cancel()
    return True


async def print_events(robot: sidestep.Robot) -> None:
    """Print each waypoint when the robot starts driving to it."""
    async for event in robot.events():
        if isinstance(event, sidestep.MissionChanged) and event.item is not None:
            print(f"waypoint {event.item} of {event.count}")


def mission_of(words: list[str]) -> Mission | str:
    """Return a mission of the places given as X,Y, or the name of a mission file."""
    if len(words) == 1 and "," not in words[0]:
        return words[0]
    places = [word.split(",") for word in words]
    return Mission(waypoints=tuple(Waypoint(x_m=float(x), y_m=float(y)) for x, y in places))


def main(argv: list[str] | None = None) -> int:
    """Drive the mission; return 0 if every waypoint was reached."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mission", nargs="+", metavar="X,Y|FILE")
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--connect", metavar="ENDPOINT")
    given = parser.parse_args(argv)
    drove = patrol(given.connect, mission_of(given.mission), given.rounds)
    return 0 if asyncio.run(drove) else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (sidestep.UserError, sidestep.RemoteError) as error:
        sys.exit(f"patrol: {error}")
