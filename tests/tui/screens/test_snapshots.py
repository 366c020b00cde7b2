"""Compare every screen with its committed picture, in several sizes and themes."""

from dataclasses import replace
from math import sin
from pathlib import Path

import pytest

from ground.app.app import GroundApp
from ground.app.appearance import Appearance
from ground.app.playback.player import Player
from ground.map.scene import MapTarget
from ground.station.link.loss import Loss, LossKind
from protocol.wire.reasons import Reason, reason_text
from runtime.clock import ManualClock
from tests.support.tui.fakes import MS, FakeCommandSink, FakeStation, S
from tests.support.tui.pilot import Stage, play, staged
from tests.support.tui.plant_side import FakeStack, on
from tests.support.tui.recording import recorded
from tests.support.tui.snapshots import ACTUAL, compare
from tests.support.tui.underway import driving

SIZES = ((80, 24), (120, 40), (200, 60), (40, 12))
THEMES = ("dark", "light", "mono")
OTHERS = {"plots": "2", "params": "3", "log": "4", "links": "5"}


def station_after_drive() -> FakeStation:
    """Return a station after twenty seconds of a drive, with series and a log."""
    station = FakeStation()
    station.note("robot r1 is there")
    station.note("r1: state, lease and 41 parameters read: ready")
    for tick in range(400):
        for name, value in figures_at(tick * 0.05).items():
            station.history[name].add(tick * 0.05, value)
    station.clock.advance(11 * S)
    station.note(f"goal 19 7: refused: {reason_text(Reason.OUTSIDE_FENCE)}", 4)
    station.note("goal 9 7: ok 14 ms")
    station.clock.advance(9 * S)
    return driving(station)


def figures_at(time_s: float) -> dict[str, float]:
    """Return values that match `driving`: the robot starts at 11 s and turns at 18 s."""
    driven_s = max(0.0, time_s - 11.1)
    wiggle = sin(3.0 * time_s)
    return {
        "speed": min(0.31, 0.4 * driven_s) + (0.01 * wiggle if driven_s else 0.0),
        "goal_distance": 8.78 - 0.265 * driven_s,
        "nearest_range": max(0.23, 2.2 - 0.24 * driven_s),
        "cycle_us": 380.0 + 31.0 * wiggle,
        "uncertainty_m": 0.02 + 0.003 * driven_s,
        "late_us": 45.0 + 20.0 * wiggle,
    }


def check(stage: Stage, name: str, *, update: bool) -> None:
    wrong = compare(stage.app.export_screenshot(title="sidestep"), name, update=update)
    assert not wrong, wrong


@pytest.mark.parametrize("theme", THEMES)
@pytest.mark.parametrize("size", SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
def test_drive_screen(size: tuple[int, int], theme: str, update_screens: bool) -> None:
    async def story() -> None:
        async with staged(size, station=station_after_drive(), theme=theme) as stage:
            check(stage, f"drive-{size[0]}x{size[1]}-{theme}", update=update_screens)

    play(story)


@pytest.mark.parametrize("theme", ["ansi", "contrast"])
def test_other_themes(theme: str, update_screens: bool) -> None:
    async def story() -> None:
        async with staged(station=station_after_drive(), theme=theme) as stage:
            check(stage, f"drive-80x24-{theme}", update=update_screens)

    play(story)


@pytest.mark.parametrize("screen", OTHERS)
@pytest.mark.parametrize("size", [(80, 24), (160, 50)], ids=["80x24", "160x50"])
def test_other_screens(screen: str, size: tuple[int, int], update_screens: bool) -> None:
    async def story() -> None:
        async with staged(size, station=station_after_drive()) as stage:
            await stage.press(OTHERS[screen])
            await stage.redraw()
            check(stage, f"{screen}-{size[0]}x{size[1]}", update=update_screens)

    play(story)


def test_loss(update_screens: bool) -> None:
    async def story() -> None:
        station = station_after_drive()
        station.clock.advance(3 * S)
        since_ns = station.now_ns - 2_900 * MS
        station.scene_now = replace(station.scene_now, live=False)
        station.loss_now = Loss(LossKind.HUNG, "r1", "no beat", "it stops by itself", since_ns)
        async with staged(station=station) as stage:
            check(stage, "loss", update=update_screens)

    play(story)


def test_mission_draft(update_screens: bool) -> None:
    async def story() -> None:
        async with staged(station=station_after_drive(), theme="mono") as stage:
            stage.commands.draft_items = (
                MapTarget(2.0, 6.5),
                MapTarget(7.5, 6.0, 0.0),
                MapTarget(7.0, 1.5),
            )
            await stage.redraw()
            check(stage, "draft", update=update_screens)

    play(story)


def test_ascii(update_screens: bool) -> None:
    async def story() -> None:
        async with staged(station=station_after_drive(), theme="ansi", ascii_only=True) as stage:
            check(stage, "drive-ascii", update=update_screens)

    play(story)


@pytest.mark.parametrize(("name", "keys"), [("help", "?"), ("choose", "v"), ("cursor", "G")])
def test_dialogs_and_cursor(name: str, keys: str, update_screens: bool) -> None:
    async def story() -> None:
        async with staged(station=station_after_drive()) as stage:
            await stage.press(keys)
            check(stage, name, update=update_screens)

    play(story)


@pytest.mark.usefixtures("worlds")
@pytest.mark.parametrize(("name", "key"), [("worlds", "6"), ("faults", "7")])
def test_worlds_and_faults(name: str, key: str, update_screens: bool) -> None:
    async def story(stage: Stage) -> None:
        await stage.press("down")
        check(stage, name, update=update_screens)

    play(lambda: on(key, FakeStack(), story))


def test_replay(tmp_path: Path, update_screens: bool) -> None:
    async def story() -> None:
        player = Player(recorded(tmp_path, suffix=".mcap"), ManualClock())
        player.seek(2.0)
        commands = FakeCommandSink()
        app = GroundApp(None, commands, appearance=Appearance(hz=0.0), player=player)
        async with app.run_test(size=(80, 24)) as pilot:
            stage = Stage(app, pilot, FakeStation(), commands)
            await stage.redraw()
            check(stage, "replay", update=update_screens)

    play(story)


def test_differing_screen_is_saved_beside_the_committed_one(tmp_path: Path) -> None:
    assert compare("<svg terminal-12-x/>", "one", update=True, folder=tmp_path) == ""
    assert compare("<svg terminal-99-x/>", "one", update=False, folder=tmp_path) == ""
    wrong = compare("<svg other/>", "one", update=False, folder=tmp_path)
    assert "make refresh" in wrong
    assert (tmp_path / f"one{ACTUAL}").read_text() == "<svg other/>\n"
