"""The asyncio client of a robot, and what it returns; `sidestep.api` has its names."""
