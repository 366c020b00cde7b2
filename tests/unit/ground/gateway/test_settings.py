import argparse
import re
from pathlib import Path

import pytest

from gateways.mavlink.endpoints import EXAMPLE
from gateways.mavlink.gateway_verb import (
    GatewaySettings,
    arguments,
    as_gateway,
    guard_of,
    settings_of,
    systems_of,
    with_policy,
)
from gateways.mavlink.signing import Policy
from ground.cli.main import main
from ground.client.connection import Common
from ground.user.mavlink_keys import KeyRing, new_key, write_keys
from protocol.bus.network import Network, Tls, gateway_here
from runtime.errors import ConfigError, UserError
from tests.support.each import each

FILE = """
robot = "r9"
[gateway]
endpoints = ["udpin:0.0.0.0:14550,require", "serial:/dev/ttyUSB0:57600"]
robots = ["r1", "r2"]
systems = { r2 = 20 }
origin = [47.4, 8.5]
altitude_m = 400.0
low_rate = true
keys = "keys.toml"
"""


def settings(*words: str, config: str | None = None) -> GatewaySettings:
    parser = argparse.ArgumentParser()
    arguments(parser)
    return settings_of(parser.parse_args(words), "r1", config)


def test_defaults_present_one_robot_as_system_1() -> None:
    found = settings()
    assert found.endpoints == (EXAMPLE,)
    assert found.systems == {"r1": 1}
    assert (found.home.latitude_deg, found.low_rate) == (-35.3632621, False)


def test_file_overrides_defaults_and_words_override_the_file(tmp_path: Path) -> None:
    path = tmp_path / "ground.toml"
    path.write_text(FILE)
    found = settings(config=str(path))
    assert found.systems == {"r1": 1, "r2": 20}
    assert (found.origin, found.altitude_m, found.low_rate) == ((47.4, 8.5), 400.0, True)
    words = ("tcpin:0.0.0.0:5760", "--robots", "r3,r2", "--system", "r3=7", "r2=9")
    found = settings(*words, "--origin", "1", "-2", config=str(path))
    assert found.endpoints == ("tcpin:0.0.0.0:5760",)
    assert found.systems == {"r3": 7, "r2": 9}
    assert found.origin == (1.0, -2.0)


def test_systems_are_numbered_in_the_order_of_the_names() -> None:
    assert systems_of(["r3", "r1", "r2"], {}) == {"r3": 3, "r1": 1, "r2": 2}
    assert systems_of(["b", "a", "c"], {"c": 1}) == {"b": 3, "a": 2, "c": 1}


@each(
    ("words", "error"),
    [
        (("--system", "r1"), "use ROBOT=ID"),
        (("--system", "r1=0"), "1 to 250"),
        (("--system", "r1=255"), "1 to 250"),
        (("--system", "r2=1"), "the gateway has no r2"),
        (("--robots", "r1,r2", "--system", "r1=4", "r2=4"), "an id of its own"),
        (("--robots", "r1", "--robots", "r1"), "only once"),
        (("--origin", "91", "0"), "LAT -85 to 85"),
        (("--origin", "47", "181"), "LON -180 to 180"),
        (("--origin", "0", "0"), "not both 0"),
    ],
)
def test_wrong_words_are_refused_with_the_fix(words: tuple[str, ...], error: str) -> None:
    with pytest.raises(UserError, match=error):
        settings(*words)


@pytest.mark.parametrize(
    "line",
    [
        "low_rat = true",
        "systems = { r1 = 0 }",
        "systems = { r1 = 256 }",
        "origin = [99, 0]",
        "origin = [0.0, 0.0]",
        'robots = ["R!"]',
        'robots = ["r1", "r1"]',
        "systems = { r1 = 4, r2 = 4 }",
        "endpoints = 5",
    ],
)
def test_wrong_key_of_the_file_is_refused(tmp_path: Path, line: str) -> None:
    path = tmp_path / "ground.toml"
    path.write_text(f"[gateway]\n{line}\n")
    with pytest.raises((ConfigError, UserError)):
        settings(config=str(path))


@each(
    ("words", "error"),
    [
        (("udpinn:127.0.0.1:1",), "did you mean udpin?"),
        (("udpin:127.0.0.1:14550,sing",), "is none of require, loopback, accept"),
        (("tcpin:0.0.0.0:14550,accept",), "use require"),
        (("udpin:127.0.0.1:0",), "port 0"),
        (("serial:/dev/none:57600",), "no such device"),
        (("--system", "r1=0"), "1 to 250"),
    ],
)
def test_wrong_words_are_refused_before_the_connection(
    words: tuple[str, ...], error: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["gateway", *words, "--connect", "tcp/127.0.0.1:1"]) == 2
    assert error in capsys.readouterr().err


def test_policy_follows_the_endpoint_after_a_comma() -> None:
    assert with_policy("udpin:127.0.0.1:14550").policy is Policy.LOOPBACK
    assert with_policy("udpin:0.0.0.0:1,accept") == ("udpin:0.0.0.0:1", Policy.ACCEPT)
    with pytest.raises(UserError, match=r"as in udpin:0\.0\.0\.0:1,require"):
        with_policy("udpin:0.0.0.0:1,requrie")


@each("host", ["0.0.0.0", "192.0.2.1"])
def test_unsigned_commands_by_tcp_are_taken_by_a_plain_word_only(host: str) -> None:
    with pytest.raises(UserError, match=r"require.*udpin.*anyone"):
        with_policy(f"tcpin:{host}:5760,accept")
    for word in ("require", "loopback", "anyone"):
        assert with_policy(f"tcpin:{host}:5760,{word}").policy is Policy(word)
    assert with_policy("tcpin:localhost:5760,accept").policy is Policy.ACCEPT
    with pytest.raises(UserError, match="unknown host"):
        with_policy("tcpin:no.such.host.invalid:5760,accept")


def test_compose_publishes_no_tcp_port_that_takes_unsigned_commands() -> None:
    text = (Path(__file__).parents[4] / "docker-compose.yml").read_text()
    found = [with_policy(one) for one in re.findall(r"(?:udpin|udpout|tcpin):[\w.:,]+", text)]
    assert found
    by_tcp = [one for one in found if one.text.startswith("tcpin")]
    assert all(one.policy is Policy.REQUIRE for one in by_tcp)


@each("person", ["", "ada"])
def test_gateway_is_another_person_than_its_user(person: str) -> None:
    """Its clients may be anybody, so they share no lease with the user's app."""
    common = Common(network=Network(person=person), robot="r1")
    assert as_gateway(common).network.person == gateway_here()
    locked = Common(network=Network(tls=Tls(ca="a", certificate="b", key="c")), robot="r1")
    assert as_gateway(locked) == locked


def test_required_signing_needs_a_key(tmp_path: Path) -> None:
    path = tmp_path / "keys.toml"
    wanted, endpoints = GatewaySettings(keys=str(path)), [with_policy("udpin:0.0.0.0:1,require")]
    with pytest.raises(UserError, match="sidestep keys signing new"):
        guard_of(wanted, endpoints)
    write_keys(path, KeyRing(key=(new_key(),)))
    guard = guard_of(wanted, endpoints)
    assert guard.is_signing
    assert guard.is_required
