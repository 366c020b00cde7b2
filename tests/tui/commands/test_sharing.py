"""The key to share a run puts its recording into one archive, or says that there is none."""

from pathlib import Path
from zipfile import ZipFile

from ground.app.appearance import Appearance
from ground.app.playback.player import Player
from runtime.clock import ManualClock
from tests.support.tui.fakes import FakeCommandSink
from tests.support.tui.pilot import play, staged
from tests.support.tui.plant_side import SynchronousApp
from tests.support.tui.recording import recorded


def test_without_a_recording_there_is_nothing_to_share() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("Z")
            assert "nothing is recorded here" in stage.log()

    play(story)


def test_a_played_recording_is_shared(tmp_path: Path) -> None:
    async def story() -> None:
        player = Player(recorded(tmp_path), ManualClock())
        app = SynchronousApp(None, FakeCommandSink(), appearance=Appearance(hz=0.0), player=player)
        async with app.run_test(size=(100, 28)) as pilot:
            await pilot.press("Z")
            await pilot.pause()
            archive = player.path.with_suffix(".zip")
            assert f"shared: {archive}" in "\n".join(line.text for line in app.station.log)
            with ZipFile(archive) as held:
                assert player.path.name in held.namelist()

    play(story)
