"""Options and settings: one [network] table and one file serve all programs."""

import argparse
from pathlib import Path
from typing import Any, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

import plant.process
import robot.run
from ground.cli.main import parse
from ground.cli.options import common_of
from protocol.bus.network import Network, Tls
from protocol.options import (
    DEFAULT_ENDPOINT,
    LOCKED_ENDPOINT,
    add_param_option,
    finite,
    network_of,
    numbers_kept,
    whole,
)
from robot.run import HostedRobot
from robot.vehicle import RobotVehicle
from runtime.errors import ConfigError, EndpointError, UserError
from tests.support.each import each


def parsed(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    parser.add_argument("x", type=float)
    parser.add_argument("--goal", type=float, nargs="+")
    parser.add_argument("-i", action="store_true")
    return parser.parse_args(numbers_kept(words))


@each("word", ["-1e3", "-1E-3", "-.5e2", "-5.", "-2", "-2.5", "-1_0e1", "-inf"])
def test_a_negative_number_is_a_value(word: str) -> None:
    found = parsed(word, "--goal", word, "3")
    assert found.x == found.goal[0] == float(word)
    assert found.goal[1] == 3.0


@given(st.floats(allow_nan=False))
def test_every_number_survives_formatting_and_parsing(value: float) -> None:
    assert parsed(repr(value), "--goal", repr(value)).goal == [value]


@each("word", ["-i", "--goal", "-e3", "-1e", "-", "--", "", "1e3", "-1", "-0.5"])
def test_other_arguments_are_unchanged(word: str) -> None:
    assert numbers_kept([word]) == [word]


@each("text", ["nan", "inf", "-inf", "1e999", "", "x", "1,5"])
def test_text_without_a_finite_number_is_rejected(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError):
        finite(text)


def test_a_whole_number_may_be_either_end_of_its_range() -> None:
    assert (whole(2, 5)("2"), whole(2, 5)(" 5"), whole(0)("123456789")) == (2, 5, 123456789)


@each(
    ("text", "says"),
    [
        ("1", "1 is not within 2 to 5"),
        ("6", "6 is not within 2 to 5"),
        ("2.5", "'2.5' is not a whole number"),
        ("", "'' is not a whole number"),
        ("nan", "'nan' is not a whole number"),
    ],
)
def test_integer_out_of_range_is_rejected(text: str, says: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match=f"^{says}$"):
        whole(2, 5)(text)


def test_without_upper_bound_only_the_minimum_is_named() -> None:
    with pytest.raises(argparse.ArgumentTypeError, match=r"^-1 is not at least 0$"):
        whole(0)("-1")


def test_parameters_are_names_with_their_values() -> None:
    parser = argparse.ArgumentParser()
    add_param_option(parser)
    assert parser.parse_args([]).param == []
    words = ["--param", "side=-1", "--param", "d_obs_m=0.4"]
    assert parser.parse_args(words).param == [("side", -1.0), ("d_obs_m", 0.4)]


@each(
    ("word", "says"),
    [
        ("d_obs_m", "write NAME=VALUE"),
        ("=1", "write NAME=VALUE"),
        ("d_obs_m=far", "'far' is not a number"),
        ("d_obs_m=inf", "'inf' is not a finite number"),
    ],
)
def test_text_without_parameter_and_value_is_rejected(
    word: str, says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    parser = argparse.ArgumentParser()
    add_param_option(parser)
    with pytest.raises(SystemExit):
        parser.parse_args(["--param", word])
    assert says in capsys.readouterr().err


HERE, THERE = "tcp/127.0.0.1:1", "tcp/127.0.0.1:2"
NO_OPTIONS = argparse.Namespace(listen=None, connect=None)


@each(
    ("mode", "listen", "connect", "robot", "plant"),
    [
        ("peer", (), (), ((DEFAULT_ENDPOINT,), ()), ((), (DEFAULT_ENDPOINT,))),
        ("peer", (HERE,), (), ((HERE,), ()), ((), (HERE,))),
        ("peer", (HERE,), (THERE,), ((HERE,), ()), ((), (THERE,))),
        ("peer", (), (THERE,), ((), (THERE,)), ((), (THERE,))),
        ("client", (HERE,), (THERE,), ((), (THERE,)), ((), (THERE,))),
    ],
)
def test_network_table_serves_listeners_and_connectors(
    mode: Literal["peer", "client"],
    listen: tuple[str, ...],
    connect: tuple[str, ...],
    robot: tuple[tuple[str, ...], tuple[str, ...]],
    plant: tuple[tuple[str, ...], tuple[str, ...]],
) -> None:
    table = Network(mode=mode, listen=listen, connect=connect, prefix="yard")
    for listens, expected in ((True, robot), (False, plant)):
        found = network_of(NO_OPTIONS, table, listens=listens)
        assert (found.listen, found.connect, found.prefix) == (*expected, "yard")
        assert found.mode == ("peer" if found.listen else "client")


def test_command_line_overrides_the_file() -> None:
    said = argparse.Namespace(listen=None, connect=[THERE])
    found = network_of(said, Network(listen=(HERE,)), listens=True)
    assert (found.mode, found.listen, found.connect) == ("client", (), (THERE,))


def test_endpoints_use_tls_when_keys_are_configured() -> None:
    table = Network(tls=Tls(ca="ca.pem", certificate="plant.pem", key="plant.key"))
    assert network_of(NO_OPTIONS, table, listens=True).listen == (LOCKED_ENDPOINT,)
    assert network_of(NO_OPTIONS, table, listens=False).connect == (LOCKED_ENDPOINT,)


TLS = Tls(ca="ca.pem", certificate="ground.pem", key="ground.key")


@each(
    "endpoint",
    [
        "tcp/127.0.0.1:7447",
        "tcp/[::]:0",
        "udp/10.0.0.1:7447",
        "unixsock-stream//run/sidestep.sock",
    ],
)
def test_good_endpoints_are_taken(endpoint: str) -> None:
    assert Network(mode="peer", listen=(endpoint,), connect=(endpoint,)).listen == (endpoint,)


@each(
    "endpoint",
    [
        "",
        "banana",
        "127.0.0.1:7447",
        "tcp/",
        "tcp/127.0.0.1",
        "tcp/127.0.0.1:",
        "tcp/:7447",
        "tcp/127.0.0.1:99999",
        "tcp/127.0.0.1:80x",
        "foo/127.0.0.1:7447",
        "ws/127.0.0.1:7447",
        "unixsock-stream/",
    ],
)
def test_a_bad_endpoint_is_named(endpoint: str) -> None:
    with pytest.raises(EndpointError) as caught:
        Network(mode="peer", listen=(endpoint,))
    assert repr(endpoint) in str(caught.value)
    assert "tcp/127.0.0.1:7447" in str(caught.value)


def test_client_needs_a_connect_endpoint() -> None:
    with pytest.raises(EndpointError, match="client needs an endpoint"):
        Network(mode="client")


def test_router_needs_a_listen_endpoint() -> None:
    with pytest.raises(EndpointError, match="router needs an endpoint"):
        Network(mode="router")


@each("prefix", ["", "a*", "/a", "a/", "a//b", "a?b"])
def test_prefix_that_is_no_plain_key_is_rejected(prefix: str) -> None:
    with pytest.raises(EndpointError, match="prefix"):
        Network(prefix=prefix)


def test_configured_keys_apply_tls_to_all_links() -> None:
    network = Network(listen=("tls/[::]:7447",), connect=("tls/robot.local:7447",), tls=TLS)
    assert network.tls is TLS


@each("endpoint", ["tcp/127.0.0.1:7447", "udp/127.0.0.1:1", "unixsock-stream/x"])
@each("where", ["listen", "connect"])
def test_plain_endpoint_among_tls_endpoints_is_rejected(where: str, endpoint: str) -> None:
    with pytest.raises(EndpointError, match="has no TLS") as caught:
        Network(tls=TLS, **{where: ("tls/127.0.0.1:1", endpoint)})  # type: ignore[arg-type]
    assert repr(endpoint) in str(caught.value)


def test_certificate_without_its_key_is_rejected() -> None:
    with pytest.raises(EndpointError, match=r"'tls/robot:7447' needs \[network\.tls\].*keys new"):
        Network(connect=("tls/robot:7447",))


def test_endpoint_option_cannot_disable_tls() -> None:
    with pytest.raises(EndpointError, match="remove the part from '#' on"):
        Network(listen=("tls/127.0.0.1:7447#enable_mtls=false",), tls=TLS)


def test_empty_tls_file_name_is_rejected() -> None:
    with pytest.raises(UserError, match="key is empty"):
        Tls(ca="ca.pem", certificate="ground.pem", key="")


def test_listener_tracks_twenty_robots_by_default() -> None:
    assert (Network().robots[0], Network().robots[-1], len(Network().robots)) == ("r1", "r20", 20)
    assert Network(robots=("kitchen",)).robots == ("kitchen",)
    with pytest.raises(UserError, match="robot name 'R 1'"):
        Network(robots=("r1", "R 1"))


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
def robot_runs(monkeypatch: pytest.MonkeyPatch) -> list[tuple[RobotVehicle, Network, str]]:
    runs: list[tuple[RobotVehicle, Network, str]] = []

    def run(robots: list[HostedRobot], network: Network, _options: Any) -> int:
        runs.extend((one.vehicle, network, one.name) for one in robots)
        return 0

    monkeypatch.setattr(robot.run, "run", run)
    return runs


@pytest.fixture
def plant_runs(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Network, list[str]]]:
    runs: list[tuple[Network, list[str]]] = []

    def run(_plant: Any, network: Network, robots: list[str], **_: Any) -> int:
        runs.append((network, robots))
        return 0

    monkeypatch.setattr(plant.process, "run", run)
    return runs


def test_each_program_reads_its_own_tables(
    file: Path,
    robot_runs: list[tuple[RobotVehicle, Network, str]],
    plant_runs: list[tuple[Network, list[str]]],
) -> None:
    assert robot.run.main(["--config", str(file)]) == 0
    assert plant.process.main(["--config", str(file)]) == 0
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
    robot_runs: list[tuple[RobotVehicle, Network, str]],
    plant_runs: list[tuple[Network, list[str]]],
) -> None:
    robot.run.main(["--config", str(file), "--id", "r2"])
    plant.process.main(["--config", str(file), "--robots", "r1,r2"])
    assert robot_runs[0][2] == "r2"
    assert plant_runs[0][1] == ["r1", "r2"]


@pytest.mark.parametrize("text", ['robt = "r1"', "[parameter]", '[network]\nlisen = ["x"]'])
def test_each_refuses_a_misspelt_name(tmp_path: Path, text: str) -> None:
    path = tmp_path / "bad.toml"
    path.write_text(text)
    for read in (robot.run.main, plant.process.main):
        with pytest.raises(ConfigError, match="unknown key"):
            read(["--config", str(path)])
    with pytest.raises(ConfigError, match="unknown key"):
        common_of(parse(["hold", "--config", str(path)]))


def test_keys_lie_beside_the_file_that_names_them(
    tmp_path: Path, robot_runs: list[tuple[RobotVehicle, Network, str]]
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
