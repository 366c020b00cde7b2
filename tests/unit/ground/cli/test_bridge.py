"""The bridge to viewers: arguments, channels, and the pages that its door admits."""

import argparse
import builtins
from ipaddress import ip_address
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gateways.foxglove_bridge import (
    Bridge,
    ListenAddress,
    answer,
    hidden_address,
    is_admitted,
    place,
    refusal_of,
    sdk,
    serve,
)
from ground.client.connection import Common
from ground.client.robot_link import RobotLink
from ground.text.output import Output
from protocol.bus.network import Network
from runtime.clock import ManualClock
from runtime.errors import UserError
from tests.support.each import each


def test_a_place_is_a_host_and_a_port() -> None:
    assert place("127.0.0.1:8765") == ListenAddress("127.0.0.1", 8765)
    assert place("::1:0") == ListenAddress("::1", 0)


@each("text", ["", "8765", ":8765", "host:", "host:-1", "host:65536", "host:x"])
def test_what_is_no_place_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="is not HOST:PORT"):
        place(text)


def test_missing_sdk_names_the_package(monkeypatch: pytest.MonkeyPatch) -> None:
    real_import = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name == "foxglove":
            raise ImportError(name)
        return real_import(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(UserError, match=r"pip install 'sidestep\[foxglove\]'"):
        sdk()


def test_bridge_collects_channels_before_it_listens(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock, rounds_ms = ManualClock(), []

    def served(*_: Any) -> Any:
        raise UserError("listens")

    monkeypatch.setattr("gateways.foxglove_bridge.served", served)
    monkeypatch.setattr(Bridge, "__init__", lambda *_: None)
    monkeypatch.setattr(Bridge, "round", lambda _, now_ns: rounds_ms.append(now_ns // 1_000_000))
    link = cast(
        RobotLink,
        SimpleNamespace(clock=clock, name="r1", common=Common(network=Network(), robot="r1")),
    )
    with pytest.raises(UserError, match="listens"):
        serve(
            argparse.Namespace(at=ListenAddress("127.0.0.1", 0), origin=[]),
            link,
            cast(Output, None),
        )
    assert rounds_ms == list(range(0, 1000, 50))


OTHER = "https://viewer.example"


@each(
    "origin",
    [
        "https://app.foxglove.dev",
        "https://studio.foxglove.dev",
        "file://",
        "http://localhost:8080",
        "https://localhost",
        "http://127.0.0.1:3000",
        "http://[::1]:8080",
        OTHER,
    ],
)
def test_origin_that_is_admitted(origin: str) -> None:
    assert is_admitted(origin, [OTHER])
    assert refusal_of(head(("Origin", origin)), [OTHER]) is None


@each(
    "origin",
    [
        "http://evil.example",
        "null",
        "",
        "http://app.foxglove.dev",
        "https://app.foxglove.dev.evil.example",
        "https://app.foxglove.dev:444",
        "http://localhost.evil.example",
        "http://localhost@evil.example",
        "http://evil@localhost",
        "http://127.0.0.1.evil.example",
        "http://192.168.1.4:8080",
        "ftp://localhost",
        "localhost",
        "http://[::1",
        "http://localhost/page",
        "file:///page.html",
        "https://viewer.example:444",
    ],
)
def test_origin_that_is_refused(origin: str) -> None:
    assert not is_admitted(origin, [OTHER])
    assert refusal_of(head(("oRIGIN", origin)), [OTHER]) is not None


def head(*fields: tuple[str, str], upgrade: str = "WebSocket") -> bytes:
    lines = ["GET / HTTP/1.1", *(f"{name}: {value}" for name, value in fields)]
    return "\r\n".join([*lines, f"Upgrade: {upgrade}", "", ""]).encode()


def test_client_without_an_origin_is_no_page() -> None:
    assert refusal_of(head(), []) is None


def test_second_origin_does_not_hide_the_first() -> None:
    fields = ("Origin", "http://localhost"), ("Origin", "http://evil.example")
    for two in (fields, fields[::-1]):
        found = refusal_of(head(*two), [])
        assert found is not None
        assert found[0] == "403 Forbidden"


def test_refusal_names_the_option_and_prints_no_control_character() -> None:
    found = refusal_of(head(("Origin", "http://evil.example\x1b[2J")), [])
    assert found is not None
    status, text = found
    assert "--origin http://evil.example[2J" in text
    assert answer(status, text).endswith(b"\r\n\r\n" + text.encode())


def test_only_web_sockets_are_admitted() -> None:
    for upgrade in ("h2c", "websocket, h2c"):
        found = refusal_of(head(upgrade=upgrade), [])
        assert found is not None
        assert found[0] == "426 Upgrade Required"


def test_hidden_address_is_on_this_computer() -> None:
    found = {hidden_address() for _ in range(100)}
    assert all(ip_address(one).is_loopback for one in found)
    assert len(found) > 90
    assert not any(one.startswith("127.0.") for one in found)
