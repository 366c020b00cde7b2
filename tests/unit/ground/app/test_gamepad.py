"""Test the gamepad as the kernel presents it: a file of events."""

import os
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from ground.app.input.gamepad import (
    ACROSS,
    ALONG,
    AT_OPENING,
    AXIS,
    BUTTON,
    CENTRED,
    EVENT,
    Gamepad,
    Stick,
)
from tests.support.each import each

L1 = 4


class PlayedDevice:
    """The other end of a device."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._number = os.open(path, os.O_RDWR)

    def send(self, *events: tuple[int, int, int]) -> None:
        """Send events of kind, number and value."""
        rows = (EVENT.pack(0, value, kind, number) for kind, number, value in events)
        os.write(self._number, b"".join(rows))

    def unplug(self) -> None:
        os.close(self._number)


@contextmanager
def played(folder: Path) -> Iterator[tuple[PlayedDevice, Gamepad]]:
    """Yield a device and the gamepad that reads it."""
    path = folder / "js0"
    os.mkfifo(path)
    device = PlayedDevice(path)
    with closing(Gamepad([folder / "js9", path])) as gamepad:
        yield device, gamepad


@each(
    ("axis", "value", "wanted"),
    [
        (ALONG, -32767, Stick(1.0, 0.0)),
        (ALONG, 32767, Stick(-1.0, 0.0)),
        (ACROSS, -32767, Stick(0.0, 1.0)),
        (ACROSS, 3000, CENTRED),
        (ALONG, -32768, Stick(1.0, 0.0)),
        (2, 32767, CENTRED),
    ],
)
def test_stick_forward_and_left_are_positive(
    axis: int, value: int, wanted: Stick, tmp_path_factory: pytest.TempPathFactory
) -> None:
    with played(tmp_path_factory.mktemp("pad")) as (device, gamepad):
        device.send((BUTTON, L1, 1), (AXIS, axis, value))
        assert gamepad.poll() == wanted


def test_stick_counts_only_while_a_shoulder_button_is_held(tmp_path: Path) -> None:
    with played(tmp_path) as (device, gamepad):
        device.send((AXIS, ALONG, -32767), (BUTTON, 0, 1))
        assert gamepad.poll() == CENTRED
        device.send((BUTTON, L1, 1))
        assert gamepad.poll() == gamepad.poll() == Stick(1.0, 0.0)
        device.send((BUTTON, L1, 0))
        assert gamepad.poll() == CENTRED


def test_button_that_was_held_at_the_opening_does_not_drive(tmp_path: Path) -> None:
    with played(tmp_path) as (device, gamepad):
        device.send((BUTTON | AT_OPENING, L1, 1), (AXIS | AT_OPENING, ALONG, -32767))
        assert gamepad.poll() == CENTRED
        device.send((BUTTON, L1, 0), (BUTTON, L1, 1))
        assert gamepad.poll() == Stick(1.0, 0.0)


def test_gamepad_that_is_unplugged_stops(tmp_path: Path) -> None:
    with played(tmp_path) as (device, gamepad):
        device.send((BUTTON, L1, 1), (AXIS, ALONG, -32767))
        assert gamepad.poll() == Stick(1.0, 0.0)
        device.unplug()
        assert gamepad.poll() == CENTRED
        assert not gamepad.is_there


def test_without_a_gamepad_the_keys_drive() -> None:
    gamepad = Gamepad([])
    assert (gamepad.is_there, gamepad.poll()) == (False, CENTRED)
