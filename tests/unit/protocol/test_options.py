"""Options: negative numbers are values, and one [network] table serves all programs."""

import argparse
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

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
