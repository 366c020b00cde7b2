"""Transfers leave room for streams and commands on a slow line (row 60)."""

import pytest

from gateways.mavlink.mav_service import FAST_BYTES_S, Pacing
from tests.support.each import each

ROUND_NS = 20_000_000


def sent_in_10_s(line_bytes_s: int | None, size: int, pause_rounds: int = 1) -> int:
    pacing, sent = Pacing({1: line_bytes_s}), 0
    for number in range(0, 500, pause_rounds):
        while pacing.take(1, size, number * ROUND_NS):
            sent += size
    return sent


@each("size", [37, 122, 279])
def test_transfer_and_streams_fit_57600_baud(size: int) -> None:
    streams_bytes_s = 2948
    assert sent_in_10_s(5760, size) / 10 + streams_bytes_s <= 5000
    assert sent_in_10_s(5760, size) / 10 >= 1500


def test_line_without_a_limit_is_fast() -> None:
    assert sent_in_10_s(None, 279) / 10 == pytest.approx(FAST_BYTES_S, rel=0.03)


def test_calm_rounds_of_50_ms_lose_no_budget() -> None:
    assert sent_in_10_s(None, 279, 2) / 10 == pytest.approx(FAST_BYTES_S, rel=0.03)


def test_pause_saves_up_little() -> None:
    pacing = Pacing({})
    while pacing.take(1, 279, 0):
        pass
    sent = 0
    while pacing.take(1, 279, 3600 * 10**9):
        sent += 279
    assert sent <= FAST_BYTES_S * 0.07
