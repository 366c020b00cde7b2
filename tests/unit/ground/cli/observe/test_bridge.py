"""The bridge: its arguments, its errors, and the channels it has before it listens."""

import argparse
import builtins
from types import SimpleNamespace
from typing import Any, cast

import pytest

from gateways.foxglove_bridge import Bridge, ListenAddress, act, place, sdk
from ground.client.connection import Common
from ground.client.link import Link
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
        Link, SimpleNamespace(clock=clock, robot="r1", common=Common(network=Network(), robot="r1"))
    )
    with pytest.raises(UserError, match="listens"):
        act(
            argparse.Namespace(at=ListenAddress("127.0.0.1", 0), origin=[]),
            link,
            cast(Output, None),
        )
    assert rounds_ms == list(range(0, 1000, 50))
