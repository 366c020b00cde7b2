"""What the bridge is told on its command line, and what it says when it cannot be."""

import argparse
import builtins
from typing import Any

import pytest

from ground.bridge import Place, place, sdk
from protocol.errors import UserError


def test_a_place_is_a_host_and_a_port() -> None:
    assert place("127.0.0.1:8765") == Place("127.0.0.1", 8765)
    assert place("::1:0") == Place("::1", 0)


@pytest.mark.parametrize("text", ["", "8765", ":8765", "host:", "host:-1", "host:65536", "host:x"])
def test_what_is_no_place_is_refused(text: str) -> None:
    with pytest.raises(argparse.ArgumentTypeError, match="is no HOST:PORT"):
        place(text)


def test_without_the_sdk_it_is_said_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    real_import = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name == "foxglove":
            raise ImportError(name)
        return real_import(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(UserError, match=r"pip install 'sidestep\[foxglove\]'"):
        sdk()
