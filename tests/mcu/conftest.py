"""The firmware, built once, and an emulated board that runs it."""

import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest

from checks import built
from firmware import build
from firmware.board import QEMU, Board


@pytest.fixture(scope="session")
def firmware() -> Path:
    """Build the firmware; skip where its tools are not installed."""
    missing = build.missing_packages()
    if shutil.which(QEMU) is None:
        missing.append("qemu-system-arm")
    if missing:
        pytest.skip(f"packages are not installed: {build.advice(missing)}")
    return built.firmware()


@pytest.fixture
def board(firmware: Path) -> Iterator[Board]:
    """Start a board that has said hello."""
    with Board.emulated(firmware) as board:
        yield board
