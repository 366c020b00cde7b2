"""Put the run that is shown into one archive, in a thread."""

from pathlib import Path
from typing import TYPE_CHECKING, Final

from ground.app.playback.app_interface import AppInterface

if TYPE_CHECKING:
    from ground.app.playback.player import Player
    from ground.launch.recording_session import RecordingSession

NOTHING: Final = "nothing is recorded here, so there is no run to share"


def share_run(
    app: AppInterface, player: "Player | None", recording: "RecordingSession | None"
) -> None:
    """Write the archive of the played recording, else of this session's; the log says where."""
    file = player.path if player is not None else None if recording is None else recording.file
    if file is None:
        app.note(NOTHING)
        return
    app.note(f"shares {file.name}")
    app.run_in_background(lambda: archive(file), app.note)


def archive(file: Path) -> str:
    """Write the archive and return the message with its path; UserError if that fails."""
    from ground.client.operations import NoProgress
    from ground.reports.share import Share  # imports the plots; rarely needed

    return f"shared: {Share(file=str(file)).run(NoProgress()).text}"
