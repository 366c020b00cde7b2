"""Define the command palette: active keys, themes, and all words of the command line."""

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, NamedTuple

from textual.command import DiscoveryHit, Hit, Hits, Provider

from ground.app.input.keymap import shown
from ground.console.app_commands import SetTheme
from ground.console.help import summaries
from ground.text.theme_names import THEMES

if TYPE_CHECKING:
    from ground.app.app import GroundApp


class PaletteEntry(NamedTuple):
    """A row of the palette."""

    text: str
    action: Callable[[], object]
    help: str


class CommandPalette(Provider):
    """Lists only what is possible now."""

    async def search(self, query: str) -> Hits:
        """Yield the entries that match a query."""
        matcher = self.matcher(query)
        for entry in self.entries():
            score = matcher.match(f"{entry.text} {entry.help}")
            if score > 0:
                yield Hit(score, matcher.highlight(entry.text), entry.action, help=entry.help)

    async def discover(self) -> Hits:
        """Yield all entries."""
        for entry in self.entries():
            yield DiscoveryHit(entry.text, entry.action, help=entry.help)

    def entries(self) -> Iterator[PaletteEntry]:
        """Return all entries."""
        app = ground_app(self.app)
        for key in app.keys_now():
            if key.id != "palette":
                yield PaletteEntry(key.description, partial(app.action_do, key.id), shown(key.keys))
        for name in THEMES:
            set_theme = partial(app.commands.perform, SetTheme(name))
            yield PaletteEntry(f"theme {name}", set_theme, "colours")
        for word, summary in summaries().items():
            yield PaletteEntry(f": {word}", partial(app.begin_line, f"{word} "), summary)


def ground_app(app: object) -> "GroundApp":
    """Return the app with its own type."""
    from ground.app.app import GroundApp

    assert isinstance(app, GroundApp), "the palette needs the ground station's app"
    return app
