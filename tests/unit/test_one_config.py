"""One configuration file serves robot, plant and ground; each rejects misspelt keys."""

from pathlib import Path
from typing import Any

import pytest

import plant.process.run
import robot.run
from ground.cli.main import parse
from ground.cli.options import common_of
from protocol.bus.network import Network, Tls
from robot.vehicle import Vehicle
from runtime.errors import ConfigError

FILE = """
robot = "r7"

[network]
listen = ["tcp/0.0.0.0:7000"]
connect = ["tcp/127.0.0.1:7000"]
prefix = "yard"

[parameters]
d_obs_m = 0.35
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "sidestep.toml"
    path.write_text(FILE)
    return path


@pytest.fixture
def robot_runs(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Vehicle, Network, str]]:
    runs: list[tuple[Vehicle, Network, str]] = []

    def run(vehicle: Vehicle, network: Network, name: str, *_: Any) -> int:
        runs.append((vehicle, network, name))
        return 0

    monkeypatch.setattr(robot.run, "run", run)
    return runs


@pytest.fixture
def plant_runs(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Network, list[str]]]:
    runs: list[tuple[Network, list[str]]] = []

    def run(_plant: Any, network: Network, robots: list[str], **_: Any) -> int:
        runs.append((network, robots))
        return 0

    monkeypatch.setattr(plant.process.run, "run", run)
    return runs


def test_each_program_reads_its_own_tables(
    file: Path,
    robot_runs: list[tuple[Vehicle, Network, str]],
    plant_runs: list[tuple[Network, list[str]]],
) -> None:
    assert robot.run.main(["--config", str(file)]) == 0
    assert plant.process.run.main(["--config", str(file)]) == 0
    ((vehicle, waiting, name),) = robot_runs
    ((dialling, robots),) = plant_runs
    common = common_of(parse(["hold", "--config", str(file)]))
    assert name == common.robot == robots[0] == "r7"
    assert vehicle.params.d_obs_m == 0.35
    assert (waiting.listen, waiting.connect) == (("tcp/0.0.0.0:7000",), ())
    for network in (dialling, common.network):
        assert (network.listen, network.connect) == ((), ("tcp/127.0.0.1:7000",))
    assert {waiting.prefix, dialling.prefix, common.network.prefix} == {"yard"}


def test_command_line_overrides_robot_names(
    file: Path,
    robot_runs: list[tuple[Vehicle, Network, str]],
    plant_runs: list[tuple[Network, list[str]]],
) -> None:
    robot.run.main(["--config", str(file), "--id", "r2"])
    plant.process.run.main(["--config", str(file), "--robots", "r1,r2"])
    assert robot_runs[0][2] == "r2"
    assert plant_runs[0][1] == ["r1", "r2"]


@pytest.mark.parametrize("text", ['robt = "r1"', "[parameter]", '[network]\nlisen = ["x"]'])
def test_each_refuses_a_misspelt_name(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(text)
    for read in (robot.run.main, plant.process.run.main):
        with pytest.raises(ConfigError, match="unknown key"):
            read(["--config", str(path)])
    with pytest.raises(ConfigError, match="unknown key"):
        common_of(parse(["hold", "--config", str(path)]))


def test_keys_lie_beside_the_file_that_names_them(
    tmp_path: Path, robot_runs: list[tuple[Vehicle, Network, str]]
) -> None:
    path = tmp_path / "robot-r1.toml"
    path.write_text(
        '[network.tls]\nca = "ca.pem"\ncertificate = "/run/r1.pem"\nkey = "own/r1.key"\n'
    )
    robot.run.main(["--config", str(path)])
    common = common_of(parse(["hold", "--config", str(path)]))
    for network in (robot_runs[0][1], common.network):
        assert network.tls == Tls(
            ca=f"{tmp_path}/ca.pem", certificate="/run/r1.pem", key=f"{tmp_path}/own/r1.key"
        )
    assert common.endpoint == "tls/127.0.0.1:7447"


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ('ca = "ca.pem"', "network.tls.certificate"),
        ('ca = "a"\ncertificate = "b"\nkey = 3', "network.tls.key"),
        ('ca = "a"\ncertificate = "b"\nkey = ""', "network.tls"),
        ('ca = "a"\ncertificate = "b"\nkeys = "c"', "network.tls.keys"),
    ],
)
def test_incomplete_tls_settings_are_named(tmp_path: Path, text: str, key: str) -> None:
    path = tmp_path / "half.toml"
    path.write_text(f"[network.tls]\n{text}\n")
    with pytest.raises(ConfigError) as caught:
        common_of(parse(["hold", "--config", str(path)]))
    assert caught.value.key == key
