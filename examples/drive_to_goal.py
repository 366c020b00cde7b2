"""Drive to a goal and print what happens on the way.

    sidestep up --headless &            # or any other robot
    python examples/drive_to_goal.py 5.4 2.0 90

Ctrl-C, or the end of the time limit, aborts the goal: the robot stops.
"""

import argparse
import asyncio
import sys

import sidestep


async def drive(
    endpoint: str | None, x_m: float, y_m: float, heading_deg: float | None, limit_s: float
) -> bool:
    """Return whether the goal was reached."""
    async with sidestep.connect(endpoint) as robot:
        printing = asyncio.create_task(print_events(robot))
        try:
            async with asyncio.timeout(limit_s):
                outcome = await robot.goto(x_m, y_m, heading_deg)
        except TimeoutError:
            print(f"not reached after {limit_s:g} s: the goal was aborted")
            return False
        finally:
            printing.cancel()
        print(outcome.text)
        return outcome.ok


async def print_events(robot: sidestep.Robot) -> None:
    """Print the changes of the goal, and the robot's texts."""
    async for event in robot.events():
        match event:
            case sidestep.GoalChanged(state=sidestep.GoalState() as state, distance_m=distance_m):
                print(f"{state.name.lower()}, {distance_m:.2f} m to go")
            case sidestep.TextReceived(text=text):
                print(f"{robot.name}: {text}")
            case _:
                pass


def main(argv: list[str] | None = None) -> int:
    """Drive to the goal; return 0 if it was reached."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("x", type=float, help="metres")
    parser.add_argument("y", type=float, help="metres")
    parser.add_argument("heading", type=float, nargs="?", help="degrees")
    parser.add_argument("--connect", metavar="ENDPOINT")
    parser.add_argument("--limit", type=float, default=120.0, metavar="S")
    given = parser.parse_args(argv)
    drove = drive(given.connect, given.x, given.y, given.heading, given.limit)
    return 0 if asyncio.run(drove) else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (sidestep.UserError, sidestep.RemoteError) as error:
        sys.exit(f"drive_to_goal: {error}")
