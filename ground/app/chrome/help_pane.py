"""Open the help above the screen that is shown."""

from ground.app.playback.app_interface import AppControl
from ground.app.widgets.map import MONO


def show_help(app: AppControl, word: str = "", *, commands: bool = False) -> None:
    """Open the help at one command, at the list of `commands`, or at its begin.

    Raise UserError when the command is unknown.
    """
    from ground.app.screens.help import (  # rarely needed, so imported late
        COMMANDS,
        HelpScreen,
        sections,
    )

    mono = app.theme == MONO
    parts = sections(app.keys_now(), word, ascii_only=app.ascii_only, is_mono=mono)
    app.push_screen(HelpScreen(parts, word or (COMMANDS if commands else "")))
