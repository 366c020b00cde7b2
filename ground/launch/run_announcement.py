"""Keep the runtime file of an `up`, so that other commands find what it runs."""

from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime

from ground.launch.launcher import Stack
from ground.launch.tls_configs import locked
from ground.text.output import Output
from ground.user.runs import RunFile, reason_of, this_run


@contextmanager
def announced(stack: Stack, output: Output) -> Iterator[None]:
    """Print the endpoint, and keep a runtime file until the block is left.

    The run goes on without a file that cannot be written.
    """
    since = datetime.now(UTC)
    endpoint = locked(stack.scenario.locks, stack.endpoint)
    file = RunFile(stack.scenario.name)
    failed = False

    def write() -> None:
        nonlocal failed
        scenario = stack.scenario
        run = this_run(
            endpoint=endpoint,
            robots=list(scenario.robots),
            world=scenario.name,
            locks=scenario.locks,
            record=scenario.record,
            recordings=[str(log.with_suffix(".mcap")) for log in stack.recordings()],
            processes=stack.processes(),
            since=since,
            stop_at=stack.stop_at,
        )
        try:
            file.write(run)
        except OSError as error:
            if not failed:
                output.note(f"other commands need --connect {endpoint}: {reason_of(error)}")
            failed = True

    output.note(f"endpoint {endpoint}; in another terminal: sidestep ground, or sidestep ps")
    stack.on_change = write
    try:
        yield
    finally:
        file.remove()
