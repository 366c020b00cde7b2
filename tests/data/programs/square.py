"""Drive a square, and say how each side ended."""

import asyncio

import sidestep
from sidestep import GoalEnded, Refused, Robot

CORNERS = ((1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (0.0, 0.0))


async def square(robot: Robot) -> list[str]:
    said: list[str] = []
    for x_m, y_m in CORNERS:
        ended: GoalEnded | Refused = await robot.goto(x_m, y_m, timeout_s=60.0)
        said.append(ended.text)
        if isinstance(ended, Refused):
            break
    return said


async def main() -> None:
    async with sidestep.connect() as robot:
        print(*await square(robot), sep="\n")


if __name__ == "__main__":
    asyncio.run(main())
