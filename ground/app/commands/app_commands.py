"""Words of the command line that concern the screen: done by the app, at once."""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

from ground.app.screens import SCREENS
from ground.console import Word
from ground.map import LAYERS
from ground.text.output import Says
from ground.text.theme_names import THEMES
from runtime.errors import UserError

if TYPE_CHECKING:
    from ground.app.app import GroundApp
    from ground.app.screens.drive import DriveScreen

NO_MAP: Final = "that is for the map: go to the Drive screen with 1"


def words_of_the_app(app: "GroundApp") -> Mapping[str, Word]:
    """For the console: every word it lists as the app's own."""
    words = Words(app)
    return {
        "quit": words.quit,
        "keys": words.keys,
        "theme": words.theme,
        "snap": words.snap,
        "screen": words.screen,
        "layers": words.layers,
        "zoom": words.zoom,
        "follow": words.follow,
        "find": words.find,
        "select": words.select,
        "teleop": words.teleop,
        "why": words.why,
        "replay": words.replay,
        "ghost": words.ghost,
        "record": words.record,
    }


class Words:
    """Each says what it did."""

    def __init__(self, app: "GroundApp") -> None:
        self._app = app

    def quit(self, options: argparse.Namespace, says: Says) -> int:
        self._app.exit(0)
        return 0

    def keys(self, options: argparse.Namespace, says: Says) -> int:
        return self.do("help")

    def theme(self, options: argparse.Namespace, says: Says) -> int:
        if options.name is None:
            says.result({}, f"themes: {', '.join(THEMES)}; now {self._app.theme}")
            return 0
        if options.name not in THEMES:
            raise UserError(f"no such theme: {options.name!r}; known: {', '.join(THEMES)}")
        self._app.theme = options.name
        return 0

    def snap(self, options: argparse.Namespace, says: Says) -> int:
        path: Path | None = options.file
        if path is None:
            return self.do("shot")
        try:
            path.write_text(self._app.export_screenshot(), encoding="utf-8")
        except OSError as error:
            raise UserError(f"{path}: {error.strerror}") from error
        says.result({}, f"saved {path}")
        return 0

    def screen(self, options: argparse.Namespace, says: Says) -> int:
        if options.name not in SCREENS:
            raise UserError(f"no such screen: {options.name!r}; known: {', '.join(SCREENS)}")
        self._app.switch_mode(options.name)
        return 0

    def layers(self, options: argparse.Namespace, says: Says) -> int:
        if not options.names:
            return self.do("layers")
        for name in options.names:
            if name not in LAYERS:
                raise UserError(f"no such layer: {name!r}; known: {', '.join(LAYERS)}")
            self.map_screen().switch_layer(name)
        return 0

    def zoom(self, options: argparse.Namespace, says: Says) -> int:
        return self.do({"in": "zoom-in", "out": "zoom-out", "fit": "fit"}[options.how])

    def follow(self, options: argparse.Namespace, says: Says) -> int:
        return self.do("follow")

    def find(self, options: argparse.Namespace, says: Says) -> int:
        """On the screen of the log, once that is there."""
        self._app.switch_mode("log")
        self._app.call_later(self.find_there, " ".join(options.text))
        return 0

    def find_there(self, words: str) -> None:
        from ground.app.screens.log import LogScreen  # imported when it is first shown

        if isinstance(self._app.sheet, LogScreen):
            self._app.sheet.find(words)

    def select(self, options: argparse.Namespace, says: Says) -> int:
        self._app.station.select(options.robot)
        return 0

    def teleop(self, options: argparse.Namespace, says: Says) -> int:
        return self.do("teleop")

    def replay(self, options: argparse.Namespace, says: Says) -> int:
        self._app.open_replay(options.file)
        return 0

    def record(self, options: argparse.Namespace, says: Says) -> int:
        recording = self._app.recording
        if recording is None:
            raise UserError("there is no robot here to record")
        if options.action == "start":
            recording.begin()
            says.result({}, "recording")
        else:
            says.result({}, f"recorded: {recording.end()}")
        return 0

    def why(self, options: argparse.Namespace, says: Says) -> int:
        return self.do("explain")

    def ghost(self, options: argparse.Namespace, says: Says) -> int:
        """Of that navigator, or of one that is chosen."""
        if options.navigator is None:
            return self.do("ghost")
        self.map_screen().haunt(options.navigator.lower())
        return 0

    def do(self, id: str) -> int:
        """What a key does, when it does anything here."""
        action = self._app.doable().get(id)
        if action is None:
            raise UserError(NO_MAP)
        action()
        return 0

    def map_screen(self) -> "DriveScreen":
        """The screen that is shown, when it has a map; UserError when it has none."""
        from ground.app.screens.drive import DriveScreen  # imported when it is first shown

        if not isinstance(self._app.sheet, DriveScreen):
            raise UserError(NO_MAP)
        return self._app.sheet
