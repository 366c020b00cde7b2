"""Every screen equals its committed picture, in several sizes, states and themes."""

import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import pairwise, permutations
from math import cos, nan, radians, sin
from pathlib import Path

import msgspec
import pytest
from rich.style import Style

from checks.harness.messages import make
from ground.app.app import GroundApp
from ground.app.appearance import Appearance
from ground.app.playback.player import Player
from ground.app.screens.drive import DriveScreen
from ground.app.widgets.map import MapWidget
from ground.map.scene import Disc, MapTarget, RobotMark
from ground.station.history.event_log import EventLog
from ground.station.link.loss import Loss, LossKind
from ground.text.wording import THEMES as THEME_NAMES_THEMES
from protocol.topics import MISSION, ODOMETRY
from protocol.wire.enums import MissionState, Vehicle
from protocol.wire.messages import MissionStatus
from protocol.wire.reasons import Reason, reason_text
from runtime.clock import ManualClock
from runtime.units import NS_PER_MS as MS
from runtime.units import NS_PER_S as S
from tests.support.app import (
    ACTUAL,
    FakeCommandSink,
    FakeStack,
    FakeStation,
    Stage,
    compare,
    drive_messages,
    driving,
    on,
    recorded,
    staged,
    stopped,
)

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
async def test_drive_screen(size: tuple[int, int], theme: str, update_screens: bool) -> None:
    async with staged(size, station=station_after_drive(), theme=theme) as stage:
        check(stage, f"drive-{size[0]}x{size[1]}-{theme}", update=update_screens)


@pytest.mark.parametrize("theme", ["ansi", "contrast"])
async def test_other_themes(theme: str, update_screens: bool) -> None:
    async with staged(station=station_after_drive(), theme=theme) as stage:
        check(stage, f"drive-80x24-{theme}", update=update_screens)


@pytest.mark.parametrize("screen", OTHERS)
@pytest.mark.parametrize("size", [(80, 24), (160, 50)], ids=["80x24", "160x50"])
async def test_other_screens(screen: str, size: tuple[int, int], update_screens: bool) -> None:
    async with staged(size, station=station_after_drive()) as stage:
        await stage.press(OTHERS[screen])
        await stage.redraw()
        check(stage, f"{screen}-{size[0]}x{size[1]}", update=update_screens)


async def test_loss(update_screens: bool) -> None:
    station = station_after_drive()
    station.clock.advance(3 * S)
    since_ns = station.now_ns - 2_900 * MS
    station.scene_now = replace(station.scene_now, live=False)
    station.loss_now = Loss(LossKind.HUNG, "r1", "no beat", "it stops by itself", since_ns)
    async with staged(station=station) as stage:
        check(stage, "loss", update=update_screens)


async def test_mission_draft(update_screens: bool) -> None:
    async with staged(station=station_after_drive(), theme="mono") as stage:
        stage.commands.draft_items = (
            MapTarget(2.0, 6.5),
            MapTarget(7.5, 6.0, 0.0),
            MapTarget(7.0, 1.5),
        )
        await stage.redraw()
        check(stage, "draft", update=update_screens)


async def test_ascii(update_screens: bool) -> None:
    async with staged(station=station_after_drive(), theme="ansi", ascii_only=True) as stage:
        check(stage, "drive-ascii", update=update_screens)


@pytest.mark.parametrize(("name", "keys"), [("help", "?"), ("choose", "v"), ("cursor", "G")])
async def test_dialogs_and_cursor(name: str, keys: str, update_screens: bool) -> None:
    async with staged(station=station_after_drive()) as stage:
        await stage.press(keys)
        check(stage, name, update=update_screens)


@pytest.mark.usefixtures("worlds")
@pytest.mark.parametrize(("name", "key"), [("worlds", "6"), ("faults", "7")])
async def test_worlds_and_faults(name: str, key: str, update_screens: bool) -> None:
    async with on(key, FakeStack()) as stage:
        await stage.press("down")
        check(stage, name, update=update_screens)


async def test_replay(tmp_path: Path, update_screens: bool) -> None:
    player = Player(recorded(tmp_path, suffix=".mcap"), ManualClock())
    player.seek(2.0)
    commands = FakeCommandSink()
    app = GroundApp(None, commands, appearance=Appearance(hz=0.0), player=player)
    async with app.run_test(size=(80, 24)) as pilot:
        stage = Stage(app, pilot, FakeStation(), commands)
        await stage.redraw()
        check(stage, "replay", update=update_screens)


def test_differing_screen_is_saved_beside_the_committed_one(tmp_path: Path) -> None:
    assert compare("<svg terminal-12-x/>", "one", update=True, folder=tmp_path) == ""
    assert compare("<svg terminal-99-x/>", "one", update=False, folder=tmp_path) == ""
    wrong = compare("<svg other/>", "one", update=False, folder=tmp_path)
    assert "make refresh" in wrong
    assert (tmp_path / f"one{ACTUAL}").read_text() == "<svg other/>\n"


DRIVE_SIZES = ((80, 24), (120, 40), (200, 60))
BEGAN_S = 1_795_425_000.0


def in_forest() -> FakeStation:
    """Return a station whose robot drives through a square world, on its second waypoint."""
    station = station_after_drive()
    lines = list(station.log)
    station.log = EventLog(began_s=BEGAN_S)
    for line in lines:
        station.log.add(line)
    world = station.world_now
    assert world is not None
    station.world_now = world._replace(size_m=(7.0, 7.0))
    trees = tuple(Disc(1.0 + 1.3 * (k % 5), 0.8 + 1.2 * (k // 5), 0.15) for k in range(25))
    around = [(3.0 + 1.2 * cos(k / 9), 2.4 + 1.2 * sin(k / 9)) for k in range(57)]
    station.mission_items_now = (MapTarget(1.6, 5.0), MapTarget(6.0, 6.2, 0.0), MapTarget(6.2, 1.4))
    station.scene_now = replace(
        station.scene_now,
        size_m=(7.0, 7.0),
        obstacles=trees,
        seen=tuple(around[:20]),
        seen_late=tuple(around[20:38]),
        seen_old=tuple(around[38:]),
        robot=RobotMark(3.0, 2.4, radians(30), 0.12),
        true_robot=RobotMark(3.12, 2.3, radians(33), 0.12),
        trail=tuple((0.6 + 0.08 * k, 0.6 + 0.06 * k) for k in range(31)),
        hits=(),
        virtual_goal=None,
        goal=MapTarget(6.0, 6.2, 0.0),
        mission=station.mission_items_now,
        current=1,
    )
    running = make(
        MissionStatus, time_ns=station.now_ns, mission_id=1, count=3, current=1,
        state=MissionState.RUNNING,
    )  # fmt: skip
    station.bus.say(MISSION, running)
    return station


def in_failsafe() -> FakeStation:
    return stopped(Vehicle.FAILSAFE, station_after_drive())


def without_robot() -> FakeStation:
    station = FakeStation()
    station.note("no robot on the bus: sidestep up starts one")
    return station


def lost() -> FakeStation:
    """Return a station whose robot does not know its place."""
    station = station_after_drive()
    odometry = drive_messages(station.now_ns)[ODOMETRY]
    odometry = msgspec.structs.replace(odometry, x_m=nan, y_m=nan, heading_rad=nan, cov_xx_m2=nan)
    station.bus.say(ODOMETRY, odometry)
    station.scene_now = replace(station.scene_now, robot=None, placed=False)
    return station


def silent() -> FakeStation:
    """Return a station whose robot has not been heard for three seconds."""
    station = station_after_drive()
    station.clock.advance(3_000 * MS)
    station.scene_now = replace(station.scene_now, live=False)
    return station


STATES: dict[str, Callable[[], FakeStation]] = {
    "forest": in_forest,
    "failsafe": in_failsafe,
    "no-robot": without_robot,
    "place-unknown": lost,
    "silent": silent,
}


@pytest.fixture
def utc(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Show clock times in UTC."""
    monkeypatch.setenv("TZ", "UTC")
    time.tzset()
    yield
    monkeypatch.undo()
    time.tzset()


@pytest.mark.usefixtures("utc")
@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("size", DRIVE_SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
async def test_drive_screen_in_a_state(
    size: tuple[int, int], state: str, update_screens: bool
) -> None:
    async with staged(size, station=STATES[state]()) as stage:
        check(stage, f"drive-{size[0]}x{size[1]}-{state}", update=update_screens)


@pytest.mark.usefixtures("utc")
@pytest.mark.parametrize("size", DRIVE_SIZES, ids=lambda size: f"{size[0]}x{size[1]}")
async def test_drive_screen_without_colours_and_unicode(
    size: tuple[int, int], update_screens: bool
) -> None:
    async with staged(size, station=in_forest(), theme="mono", ascii_only=True) as stage:
        check(stage, f"drive-{size[0]}x{size[1]}-mono-ascii", update=update_screens)
        text = "".join(strip.text for strip in stage.app.screen._compositor.render_strips())
        assert text.isascii()


PAIRS = tuple(permutations(THEME_NAMES_THEMES, 2))
SCREENS = "12345678"
Row = list[tuple[str, Style | None]]


def chain() -> Iterator[str]:
    """Yield themes so that each ordered pair of themes is next to each other once."""
    left = {
        theme: [other for other in THEME_NAMES_THEMES if other != theme]
        for theme in THEME_NAMES_THEMES
    }
    here, way = THEME_NAMES_THEMES[0], list[str]()
    back: list[str] = []
    while here or back:
        if left[here]:
            back.append(here)
            here = left[here].pop()
            continue
        way.append(here)
        if not back:
            break
        here = back.pop()
    yield from reversed(way)


def styles(stage: Stage) -> list[Row]:
    """Return what the terminal shows: the text of each segment with its style."""
    strips = stage.app.screen._compositor.render_strips()
    return [[(segment.text, segment.style) for segment in strip.simplify()] for strip in strips]


async def settled(stage: Stage) -> list[Row]:
    """Draw until nothing changes any more: Textual lays out a new screen in several frames."""
    before, found = None, styles(stage)
    while found != before:
        await stage.redraw()
        before, found = found, styles(stage)
    return found


def differing(found: list[Row], wanted: list[Row]) -> list[tuple[Row, Row]]:
    return [pair for pair in zip(found, wanted, strict=True) if pair[0] != pair[1]][:1]


async def switch(stage: Stage, theme: str) -> None:
    """Switch as the app does: a frame is drawn at once, before Textual applies the style sheet."""
    stage.app.theme = theme
    stage.app.redraw()
    styles(stage)
    await stage.redraw()


def test_chain_holds_every_pair_of_themes() -> None:
    themes = list(chain())
    assert set(pairwise(themes)) == set(PAIRS)


@pytest.mark.sweep(2)
@pytest.mark.parametrize("size", [(80, 24), (160, 50)], ids=str)
async def test_map_takes_the_background_of_every_next_theme(size: tuple[int, int]) -> None:
    themes = list(chain())
    async with staged(size, theme=themes[0]) as stage:
        for theme in themes[1:]:
            await switch(stage, theme)
            assert isinstance(stage.app.screen, DriveScreen)
            for shown in stage.app.screen.query(MapWidget):
                wanted = shown.rich_style.bgcolor
                strips = [shown.render_line(row) for row in range(shown.size.height)]
                found = {one.style.bgcolor for strip in strips for one in strip if one.style}
                assert found <= {wanted}, theme


@pytest.mark.usefixtures("worlds")
@pytest.mark.sweep(2)
@pytest.mark.parametrize("switches", [4, len(PAIRS)])
async def test_switched_theme_looks_like_a_fresh_start_on_every_screen(switches: int) -> None:
    themes = list(chain())[: switches + 1]
    turns = [
        (theme, (SCREENS[turn % len(SCREENS)], SCREENS[(turn + 3) % len(SCREENS)]))
        for turn, theme in enumerate(themes[1:])
    ]
    wanted = {(theme, key) for theme, keys in turns for key in keys}
    fresh = {}
    for one in {theme for theme, _ in turns}:
        async with staged(theme=one) as stage:
            for key in SCREENS:
                if (one, key) in wanted:
                    await stage.press(key)
                    fresh[one, key] = await settled(stage)
    async with staged(theme=themes[0]) as stage:
        for theme, keys in turns:
            await stage.press(keys[0])
            await switch(stage, theme)
            for key in keys:
                await stage.press(key)
                assert differing(await settled(stage), fresh[theme, key]) == [], (theme, key)
