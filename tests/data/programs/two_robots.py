"""Drive two robots at once, and stop both if one is refused."""

import asyncio

import sidestep
from sidestep import Refused


async def drive(name: str, x_m: float) -> float | None:
    async with sidestep.connect(robot=name) as robot:
        ended = await robot.goto(x_m, 2.0)
        return None if isinstance(ended, Refused) else ended.distance_m


async def main() -> None:
    distances_m = await asyncio.gather(drive("r1", 2.0), drive("r2", 3.0))
    print(distances_m)
    if None in distances_m:
        async with sidestep.connect() as robot:
            await robot.emergency_stop_all()


if __name__ == "__main__":
    asyncio.run(main())
