"""Each client performs all steps of a scenario: on a clean line, on a lossy line, and by TCP."""

import sys
from pathlib import Path

import pytest

from checks.built import BuildError
from tests.interop.environments import Installed, installed, is_expected
from tests.interop.scenario import CLIENTS, Client, keep, read, run
from tests.interop.vehicle import LINES, robot_on_air

pytestmark = pytest.mark.interop


@pytest.fixture
def program(client: Client) -> Installed:
    """Return what runs a client: the Python of its own environment, if it has one."""
    if client.environment is None:
        return Installed(Path(sys.executable), {})
    try:
        return installed(client.environment)
    except BuildError as error:
        pytest.skip(f"{client.name} is not installed: {error}")


def marks_of(client: Client, line: str) -> list[pytest.MarkDecorator]:
    """Return `brief` for what the gate has time for: real clients on a clean line."""
    is_brief = client.is_real and line == "clean"
    is_brief &= client.environment is None or is_expected(client.environment)
    return [pytest.mark.brief] if is_brief else []


CASES = [
    pytest.param(client, line, marks=marks_of(client, line), id=f"{client.name}-{line}")
    for line in LINES
    for client in CLIENTS
    if not (client.listens and line == "tcp")  # there the gateway asks for a HEARTBEAT first
    if not (client.hangs and line == "poor")
]


@pytest.mark.parametrize(("client", "line"), CASES)
def test_client_completes_every_step(
    client: Client, line: str, seed: int, program: Installed, tmp_path: Path
) -> None:
    with robot_on_air(tmp_path, line, seed, listens=client.listens) as robot:
        output = run(client, program, robot, tmp_path)
        said = robot.gateway.said
    found = read(output)
    keep(client, line, seed, output, found)
    assert not found.failures, "\n".join([*found.failures, said[-500:]])
    assert [one["step"] for one in found.steps] == list(client.steps)
