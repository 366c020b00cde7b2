"""Test that received text, files and names never control the terminal, on any screen."""

from dataclasses import replace

import pytest
from rich.segment import Segment
from textual.color import Color

from ground.app.widgets.lines import Printable
from ground.client.telemetry import Age
from ground.console.completion import Assistance, Candidate
from ground.station.link.loss import Loss, LossKind
from ground.station.link.streams import StreamRow
from ground.station.robot.lease_state import LeaseView
from protocol.topics import HEARTBEAT, Role
from protocol.wire.enums import Severity
from tests.support.each import each
from tests.support.hostile import LETTERS, OWNED, TEXT, raw_in
from tests.support.tui.fakes import MS, FakeCommandSink, FakeStation
from tests.support.tui.pilot import Stage, play, staged
from tests.support.tui.underway import driving, parameter

SCREENS = {
    "drive": (), "plots": ("2",), "params": ("3",), "log": ("4",), "links": ("5",),
    "worlds": ("6",), "faults": ("7",), "help": ("question_mark",), "why": ("e",),
    "palette": ("ctrl+p",), "robots": ("o",), "completion": ("colon", "g"),
}  # fmt: skip
SHOWS = ("drive", "params", "log", "links", "worlds", "faults", "completion")
"""Screens that must show the hostile text, so that a blank screen does not pass."""


def hostile() -> FakeStation:
    station = driving(FakeStation())
    station.parameters_now = (replace(parameter(f"p{TEXT}", 0.3, 0.4, f"doc {TEXT}"), unit=TEXT),)
    station.streams_now = [StreamRow(HEARTBEAT, 1.0, MS, Age.LIVE, 1, 0, 0.0, 3, f"no {TEXT}")]
    station.lease_now = LeaseView(held=True, holder=TEXT, name=TEXT)
    station.robots_now = ["r1", f"r{TEXT}"]
    station.last_now = station.cause_now = station.restarted_now = TEXT
    station.restarts_now = {Role.ROBOT: 2}
    for number in range(3):
        station.note(f"{number} {TEXT}", Severity.ERROR)
    station.loss_now = Loss(LossKind.HUNG, TEXT, TEXT, TEXT, station.now_ns)
    return station


def screen_of(stage: Stage) -> str:
    """Return all text on the terminal, including Textual's own widgets."""
    strips = stage.app.screen._compositor.render_strips()
    return "\n".join("".join(segment.text for segment in strip) for strip in strips)


@pytest.fixture
def worlds(monkeypatch: pytest.MonkeyPatch) -> None:
    def ask(*words: str) -> dict[str, object]:
        if words == ("list",):
            return {"worlds": [{"name": f"w{TEXT}", "says": f"says {TEXT}"}]}
        fault = {"kind": f"k{TEXT}", "targets": [TEXT], "unit": TEXT, "says": TEXT}
        return {"faults": [fault]}

    monkeypatch.setattr("ground.app.screens.worlds.query_worlds", ask)
    monkeypatch.setattr("ground.app.screens.faults.query_worlds", ask)
    monkeypatch.setattr("ground.app.screens.worlds.read_reached_counts", dict)


@pytest.mark.usefixtures("worlds")
def test_no_screen_shows_a_control_character(monkeypatch: pytest.MonkeyPatch) -> None:
    offered = Assistance((Candidate(f"g{TEXT}", f"g{TEXT}", f"meaning {TEXT}"),), f"hint {TEXT}")
    monkeypatch.setattr(FakeCommandSink, "assist", lambda _self, _text: offered)

    async def story() -> None:
        async with staged((120, 40), station=hostile()) as stage:
            for name, keys in SCREENS.items():
                await stage.press("escape", "1", *keys)
                shown = screen_of(stage)
                assert raw_in(shown) == [], name
                assert (OWNED in shown) or name not in SHOWS, name

    play(story)


@each("letter", LETTERS)
def test_replacing_characters_keeps_the_width_of_a_row(letter: str) -> None:
    """Textual has counted the cells already, so that one more would break the line."""
    before = [Segment(f"a{letter}b"), Segment("c")]
    after = Printable().apply(before, Color(0, 0, 0))
    assert raw_in("".join(segment.text for segment in after)) == []
    assert sum(one.cell_length for one in after) == sum(one.cell_length for one in before)
