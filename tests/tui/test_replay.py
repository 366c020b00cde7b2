"""The replay screen, and ghosts on the map."""

import asyncio
import json
from pathlib import Path
from threading import Event
from typing import Any

import pytest

from checks.harness.until import PATIENCE_S
from ground.app.app import GroundApp
from ground.app.appearance import Appearance
from ground.app.commands.local_commands import LocalCommands
from ground.app.playback.player import Player
from ground.app.screens.replay import ReplayScreen, in_one_line, newest_recordings, timeline_rows
from ground.app.widgets.rows import width_of, words_of
from ground.client.outcomes import NoProgress
from ground.commands.export import Export
from ground.console.app_commands import AppCommand
from ground.console.parser import read
from ground.user.folders import recordings_folder
from protocol.world import as_json
from runtime.clock import ManualClock
from runtime.errors import UserError
from runtime.units import NS_PER_S as S
from tests.support.app import FakeCommandSink, FakeStation, Stage, driving, recorded, staged
from tests.support.each import each
from tests.support.ground.made_recordings import mcap, run, written
from tests.support.plant import plain_world


def player(folder: Path) -> tuple[Player, ManualClock]:
    clock = ManualClock()
    return Player(recorded(folder), clock), clock


def test_player_has_a_speed_and_stops_at_the_end(tmp_path: Path) -> None:
    shown, clock = player(tmp_path)
    shown.play_or_pause()
    clock.advance(1 * S)
    shown.poll()
    assert shown.position_s == pytest.approx(1.0)
    shown.faster(2.0)
    clock.advance(1 * S)
    shown.poll()
    assert shown.position_s == pytest.approx(3.0)
    clock.advance(3600 * S)
    shown.poll()
    assert (shown.position_s, shown.playing) == (shown.duration_s, False)


def test_a_step_is_one_control_period(tmp_path: Path) -> None:
    shown, _ = player(tmp_path)
    shown.seek(2.0)
    shown.step(1)
    one = shown.position_s
    shown.step(1)
    assert shown.position_s - one == pytest.approx(0.05, abs=0.02)
    shown.step(-1)
    assert shown.position_s == pytest.approx(one)


def test_seeking_back_forgets_later_messages(tmp_path: Path) -> None:
    shown, _ = player(tmp_path)
    shown.seek(3.0)
    later = len(shown.station.scene().trail)
    shown.seek(0.5)
    assert len(shown.station.scene().trail) < later
    assert not shown.playing


def test_replay_refuses_commands(tmp_path: Path) -> None:
    shown, _ = player(tmp_path)
    assert "replay" in shown.station.queue.refusal(moves=False)


def test_file_that_is_not_a_recording_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.tlog").write_bytes(b"nothing of the sort")
    with pytest.raises(UserError):
        Player(tmp_path / "x.tlog", ManualClock(), "r1")


@each("width", [0, 1, 20, 80, 200])
def test_timeline_fits_its_width(width: int, tmp_path: Path) -> None:
    shown, _ = player(tmp_path)
    shown.seek(1.0)
    rows = timeline_rows(shown, width)
    assert all(width_of(one) <= width for one in rows)
    if width == 80:
        assert "1.00 /" in words_of(rows[0])


def test_recordings_are_found_in_the_users_folder_and_one_folder_deep(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    recordings_folder().mkdir(parents=True)
    (recordings_folder() / "20261123T100000Z-r1.tlog").touch()
    monkeypatch.chdir(tmp_path)
    for name in ("a.mcap", "a.tlog", "sub/b.tlog", "sub/deep/c.tlog", "d.txt"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"")
    names = {one.path.name for one in newest_recordings()}
    assert names == {"a.mcap", "b.tlog", "20261123T100000Z-r1.tlog"}


def test_a_recording_that_runs_is_the_last_choice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.chdir(tmp_path)
    for second in (1, 2, 3):
        (tmp_path / f"20261123T10000{second}Z-r1.tlog").touch()
    with written(tmp_path / "20261123T100003Z-r1.tlog"):
        *finished, last = map(in_one_line, newest_recordings())
    names = [line.split()[-1] for line in finished]
    assert names == ["20261123T100002Z-r1.tlog", "20261123T100001Z-r1.tlog"]
    assert last.endswith("20261123T100003Z-r1.tlog  is still being recorded")


async def test_a_recording_is_chosen_and_read_in_the_background(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    recordings_folder().mkdir(parents=True)
    recorded(recordings_folder())
    seen = Event()

    def read(*given: Any, **how: Any) -> Player:
        assert seen.wait(PATIENCE_S)
        return Player(*given, **how)

    monkeypatch.setattr("ground.app.playback.player.Player", read)
    async with staged() as stage:
        app = stage.app
        await stage.press("8", "o")
        await stage.until(lambda: len(app.screen_stack) > 1)
        await stage.press("enter")
        assert "reading 20231114T221320Z-r1.tlog" in stage.words("timeline")
        seen.set()
        await stage.until(lambda: app.player)
        await stage.redraw()
        assert "/ 3.9" in stage.words("timeline")


async def test_a_recording_that_cannot_be_played_is_reported_in_the_log(tmp_path: Path) -> None:
    path = tmp_path / "x.tlog"
    path.write_bytes(b"nothing of the sort")
    async with staged() as stage:
        app = stage.app
        with pytest.raises(UserError, match="no such file"):
            app.open_replay(tmp_path / "missing.tlog")
        app.open_replay(path)
        await stage.pilot.pause()
        await stage.until(lambda: "holds no frame" in stage.log())
        assert (app.player, app.reader.words) == (None, "")


def test_progress_of_reading_ends_at_the_whole(tmp_path: Path) -> None:
    path, shares = recorded(tmp_path, 60.0), list[float]()
    Player(path, ManualClock(), progress=shares.append)
    assert len(shares) > 3
    assert shares == sorted(shares)
    assert shares[-1] > 0.8


async def test_keys_control_the_replay(tmp_path: Path) -> None:
    shown, _ = player(tmp_path)
    commands = FakeCommandSink()
    app = GroundApp(None, commands, appearance=Appearance(hz=0.0), player=shown)
    async with app.run_test(size=(100, 28)) as pilot:
        stage = Stage(app, pilot, FakeStation(), commands)
        await stage.redraw()
        assert isinstance(app.screen, ReplayScreen)
        assert "REPLAY" in stage.words("status")
        await stage.press("pagedown")
        assert shown.position_s > 1.0
        await stage.press("p")
        assert shown.playing
        await stage.press("p", "home")
        assert shown.position_s == 0.0
        await stage.press("G", "enter")
        assert commands.given == []
        assert "this is a replay" in "\n".join(line.text for line in shown.station.log)


FLOOR = plain_world("floor", (10.0, 8.0), (0.8, 1.0), (9.0, 7.0))


def simulated() -> FakeStation:
    station = driving(FakeStation())
    assert station.world_now is not None
    station.world_now = station.world_now._replace(text=json.dumps(as_json(FLOOR, None)))
    return station


async def ended(stage: Stage) -> None:
    pause = Event()
    async with asyncio.timeout(PATIENCE_S):
        while stage.drive.ghost_runner.busy:
            pause.wait(0.01)
            await stage.redraw()
    await stage.redraw()


async def test_chosen_ghost_is_drawn_on_the_map() -> None:
    async with staged((110, 30), station=simulated()) as stage:
        await stage.press("n")
        await stage.press("enter")  # the first of the list
        assert [ghost.label for ghost in stage.drive.map.scene.ghosts] == ["bug"]
        await ended(stage)
        (ghost,) = stage.drive.map.scene.ghosts
        assert (ghost.label, ghost.outcome) == ("bug", "reached")
        assert ghost.path_m[0] == pytest.approx((4.15, 2.80), abs=1e-6)
        assert "ghost bug: reached after" in stage.log()


async def test_refused_ghost_is_explained_in_the_log() -> None:
    station = driving(FakeStation())
    station.world_now = None
    async with staged(station=station) as stage:
        await stage.press("n", "enter")
        assert "no ghost: the world is unknown" in stage.log()
        assert stage.drive.map.scene.ghosts == []


async def test_ghost_command_checks_the_navigator() -> None:
    async with staged(station=simulated()) as stage:
        words = LocalCommands(stage.app)

        def typed(line: str) -> str:
            command = read(line)
            assert isinstance(command, AppCommand)
            return words.do_command(command)

        assert typed("ghost vgm") == ""
        await ended(stage)
        assert [ghost.label for ghost in stage.drive.map.scene.ghosts] == ["vgm"]
        assert typed("ghost none") == ""
        await stage.redraw()
        assert stage.drive.map.scene.ghosts == []
        with pytest.raises(UserError):
            typed("ghost vfh")


async def test_ghosts_end_with_the_app() -> None:
    async with staged(station=simulated()) as stage:
        screen = stage.drive
        screen.start_ghost("all")
        assert screen.ghost_runner.busy
    assert not screen.ghost_runner.busy


def test_drive_of_a_bag_is_on_the_map(tmp_path: Path) -> None:
    file = mcap(tmp_path / "drive.mcap", list(run(60)))
    Export(file=str(file), ros2=str(tmp_path / "bag")).run(NoProgress())
    shown = Player(tmp_path / "bag", ManualClock())
    shown.seek(2.5)
    scene = shown.station.scene()
    assert scene.robot is not None
    assert scene.robot.x_m == pytest.approx(0.6 + 0.0125 * 39, abs=0.02)
    assert len(scene.trail) > 2
    assert scene.seen
