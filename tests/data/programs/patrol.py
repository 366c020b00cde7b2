"""Drive between two places until something is near ahead."""

import asyncio
from math import inf

import sidestep
from sidestep import Robot, SonarScan

NEAR_M = 0.4


def ahead_m(scan: SonarScan) -> float:
    """Return the nearest range ahead; sonars without a measurement do not count."""
    return min((one for one in scan.ranges_m[3:5] if one is not None), default=inf)


async def watch(robot: Robot) -> float:
    async for scan in robot.sonar():
        if ahead_m(scan) < NEAR_M:
            return ahead_m(scan)
    return inf


async def patrol(robot: Robot) -> None:
    for x_m in (1.0, 3.0):
        await robot.goto(x_m, 2.0)


async def main() -> None:
    async with sidestep.connect() as robot, asyncio.TaskGroup() as group:
        driving = group.create_task(patrol(robot))
        print(f"something is {await watch(robot):.2f} m ahead")
        driving.cancel()


if __name__ == "__main__":
    asyncio.run(main())
