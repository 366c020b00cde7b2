"""The command palette: what keys do at this moment, themes, and every word of the command line."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from textual.command import DiscoveryHit, Hit, Hits, Provider

from ground.app.input.keymap import shown
from ground.console.app_commands import SetTheme
from ground.console.help import says_of
from ground.text.theme_names import THEMES

if TYPE_CHECKING:
    from ground.app.app import GroundApp


class PaletteEntry(NamedTuple):
    text: str
    does: Callable[[], object]
    help: str


class CommandPalette(Provider):
    """Lists only what can be done here and now."""

    async def search(self, query: str) -> Hits:
        matcher = self.matcher(query)
        for entry in self.entries():
            score = matcher.match(f"{entry.text} {entry.help}")
            if score > 0:
                yield Hit(score, matcher.highlight(entry.text), entry.does, help=entry.help)

    async def discover(self) -> Hits:
        for entry in self.entries():
            yield DiscoveryHit(entry.text, entry.does, help=entry.help)

    def entries(self) -> Iterator[PaletteEntry]:
        app = ground_app(self.app)
        for key in app.keys_now():
            if key.id != "palette":
                yield PaletteEntry(key.says, partial(app.action_do, key.id), shown(key.keys))
        for name in THEMES:
            yield PaletteEntry(f"theme {name}", partial(app.perform, SetTheme(name)), "colours")
        for word, says in says_of().items():
            yield PaletteEntry(f": {word}", partial(app.begin_line, f"{word} "), says)


def ground_app(app: object) -> "GroundApp":
    from ground.app.app import GroundApp

    assert isinstance(app, GroundApp), "the palette is that of the ground station"
    return app
