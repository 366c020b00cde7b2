"""Defaults, then the file, then the command line; a misspelt key is refused by name."""

from pathlib import Path

import pytest

from ground.cli.main import parse
from ground.cli.options import common_of, listening_of
from runtime.errors import ConfigError

FILE = """
robot = "r7"
[network]
connect = ["tcp/127.0.0.1:9001"]
listen = ["tcp/127.0.0.1:9002"]
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "ground.toml"
    path.write_text(FILE)
    return path


def test_without_anything_the_robot_of_this_machine_is_dialled() -> None:
    common = common_of(parse(["hold"]))
    assert (common.robot, common.endpoint) == ("r1", "tcp/127.0.0.1:7447")
    assert common.network.mode == "client"
    assert common.network.connect_timeout_s < 2.0


def test_the_file_counts_and_the_command_line_counts_more(file: Path) -> None:
    by_file = common_of(parse(["hold", "--config", str(file)]))
    assert (by_file.robot, by_file.endpoint) == ("r7", "tcp/127.0.0.1:9001")
    assert by_file.network.listen == ()
    options = parse(["hold", "--config", str(file), "--id", "r2", "--connect", "tcp/[::1]:1"])
    by_line = common_of(options)
    assert (by_line.robot, by_line.endpoint) == ("r2", "tcp/[::1]:1")


def test_a_router_listens(file: Path) -> None:
    assert listening_of(parse(["router"])).listen == ("tcp/127.0.0.1:7447",)
    assert listening_of(parse(["router", "--config", str(file)])).mode == "router"
    listening = listening_of(parse(["router", "--config", str(file), "--listen", "tcp/0.0.0.0:5"]))
    assert listening.listen == ("tcp/0.0.0.0:5",)


def test_a_misspelt_key_is_named(tmp_path: Path) -> None:
    path = tmp_path / "bad.toml"
    path.write_text("[network]\nconect = []\n")
    with pytest.raises(ConfigError, match=r"network.conect: unknown key; did you mean 'connect'"):
        common_of(parse(["hold", "--config", str(path)]))
