"""The parts of the ground station's benchmark work separately."""

from argparse import ArgumentParser

import pytest

from checks.harness.terminal import Terminal
from checks.speed.ground_station import app_figures as ground
from checks.speed.ground_station.app_memory import sizes_mb
from checks.speed.ground_station.app_terminal import first, held, stopped
from protocol.wire.message import Message
from protocol.wire.messages import WheelCommand


def wheels(speed_mrad_s: int) -> Message:
    return WheelCommand(
        time_ns=1, seq=1, sense_seq=1, left_mrad_s=speed_mrad_s, right_mrad_s=0, ttl_ms=150
    )


def test_terminal_counts_output_and_times_words() -> None:
    with Terminal(("--version",), (80, 24)) as terminal:
        at_ns = terminal.shown("sidestep", 20.0)
        assert terminal.begun_ns < terminal.first_ns <= at_ns
        assert terminal.text().startswith("sidestep")


def test_output_is_read_after_the_process_has_ended() -> None:
    with Terminal(("--version",), (80, 24), most_per_s=20) as terminal:
        assert terminal.shown("sidestep", 20.0) > terminal.first_ns


def test_missing_words_raise_an_error_with_the_screen() -> None:
    with (
        Terminal(("no-such-verb",), (80, 24)) as terminal,
        pytest.raises(RuntimeError, match="not on the screen: 'Palette'"),
    ):
        terminal.shown("Palette", 20.0)


def test_first_reaction_after_the_key_counts() -> None:
    seen = [(wheels(0), 10), (wheels(900), 20), (wheels(0), 40), (wheels(0), 50)]
    assert first(seen, 15, stopped) == 40
    assert first(seen, 50, stopped) is None
    assert not held(wheels(0))


def test_memory_is_read_after_each_tenth() -> None:
    sizes = sizes_mb(0.1, 12_000)
    assert len(sizes) == 11
    assert sizes[-1] - sizes[1] < 40.0


def test_every_part_can_be_selected() -> None:
    parser = ArgumentParser()
    ground.add_options(parser)
    assert parser.parse_args(["--parts", "paint", "cost"]).parts == ["paint", "cost"]
    assert set(parser.parse_args([]).parts) == set(ground.PARTS)
