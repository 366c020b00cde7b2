"""Runtime files of runs whose `up` is this test."""

from datetime import UTC, datetime

from ground.user.runs import Run, RunFile, this_run

ENDPOINT = "tcp/127.0.0.1:53985"


def run_here(endpoint: str = ENDPOINT, world: str = "box", locks: str | None = None) -> Run:
    """Return a run whose process is this one."""
    return this_run(
        endpoint=endpoint,
        robots=["r1"],
        world=world,
        locks=locks,
        record=None,
        recordings=[],
        processes={"plant": 5},
        since=datetime.now(UTC),
    )


def written(endpoint: str = ENDPOINT, world: str = "box", locks: str | None = None) -> RunFile:
    """Write a runtime file into the user's folder."""
    file = RunFile(world)
    file.write(run_here(endpoint, world, locks))
    return file
