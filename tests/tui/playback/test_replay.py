"""Test the player and the replay screen: they play, step and seek, without commands."""

from pathlib import Path

import pytest

from ground.app.app import GroundApp
from ground.app.appearance import Appearance
from ground.app.playback.player import Player
from ground.app.screens.replay import ReplayScreen, recordings, timeline_rows
from ground.app.widgets.rows import width_of, words_of
from runtime.clock import ManualClock
from runtime.errors import UserError
from tests.support.tui.fakes import FakeCommandSink, FakeStation, S
from tests.support.tui.pilot import Stage, play
from tests.support.tui.recording import recorded


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
    assert "replay" in shown.station.refusal(moves=False)


def test_file_that_is_not_a_recording_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.tlog").write_bytes(b"nothing of the sort")
    with pytest.raises(UserError):
        Player(tmp_path / "x.tlog", ManualClock(), "r1")


@pytest.mark.parametrize("width", [0, 1, 20, 80, 200])
def test_timeline_fits_its_width(width: int, tmp_path: Path) -> None:
    shown, _ = player(tmp_path)
    shown.seek(1.0)
    rows = timeline_rows(shown, width)
    assert all(width_of(one) <= width for one in rows)
    if width == 80:
        assert "1.00 /" in words_of(rows[0])


def test_recordings_are_found_one_folder_deep(tmp_path: Path) -> None:
    for name in ("a.mcap", "a.tlog", "sub/b.tlog", "sub/deep/c.tlog", "d.txt"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"")
    assert {Path(one).name for one in recordings(tmp_path)} == {"a.mcap", "b.tlog"}


def test_keys_control_the_replay(tmp_path: Path) -> None:
    async def story() -> None:
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

    play(story)
