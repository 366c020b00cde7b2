"""Each client performs all steps of a scenario, on a clean line and on a lossy line."""

import sys
from pathlib import Path

import pytest

from checks.built import BuildError
from tests.interop.clients.steps import STEPS
from tests.interop.environments import python_of
from tests.interop.scenario import CLIENTS, Client, keep, read, run
from tests.interop.vehicle import LINES, robot_on_air

pytestmark = pytest.mark.interop


@pytest.fixture
def python(client: Client) -> Path:
    """Return the Python that runs a client: that of its own environment, if it has one."""
    if client.environment is None:
        return Path(sys.executable)
    try:
        return python_of(client.environment)
    except BuildError as error:
        pytest.skip(f"{client.name} is not installed: {error}")


def marks_of(client: Client, line: str) -> list[pytest.MarkDecorator]:
    """Return `brief` for what the gate has time for: real clients on a clean line."""
    return [pytest.mark.brief] if client.is_real and line == "clean" else []


CASES = [
    pytest.param(client, line, marks=marks_of(client, line), id=f"{client.name}-{line}")
    for line in LINES
    for client in CLIENTS
]


@pytest.mark.parametrize(("client", "line"), CASES)
def test_client_completes_every_step(
    client: Client, line: str, seed: int, python: Path, tmp_path: Path
) -> None:
    with robot_on_air(tmp_path, line, seed) as robot:
        output = run(client, python, robot, tmp_path)
        said = robot.gateway.said
    found = read(output)
    keep(client.name, line, seed, output, found)
    assert not found.failures, "\n".join([*found.failures, said[-500:]])
    assert [one["step"] for one in found.steps] == list(STEPS)
