"""Define the command palette: active keys, themes, and all words of the command line."""

from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple, Protocol, runtime_checkable

from textual.command import DiscoveryHit, Hit, Hits, Provider

from ground.app.chrome.key_bar import refusal_of
from ground.app.commands.command_sink import CommandSink
from ground.app.input.keymap import KeyBinding, shown
from ground.app.screens.app_screen import AppScreen
from ground.console.app_commands import SetTheme
from ground.console.parser import summaries
from ground.text.wording import THEMES


@runtime_checkable
class PaletteApp(Protocol):
    """The app as its palette sees it."""

    palette_uses: Counter[str]
    """How often each entry was used."""
    commands: CommandSink

    @property
    def base_screen(self) -> AppScreen | None:
        """The screen below any dialogs."""

    def keys_now(self) -> list[KeyBinding]:
        """Return the keys of the base screen."""

    def run_chosen(self, id: str) -> None:
        """Run an action chosen from a list."""

    def begin_line(self, text: str) -> None:
        """Let the operator continue typing a command."""


class PaletteEntry(NamedTuple):
    """A row of the palette."""

    text: str
    action: Callable[[], object]
    help: str


class CommandPalette(Provider):
    """Lists only what is possible now: first what was used most, then what continues from here."""

    async def search(self, query: str) -> Hits:
        """Yield the entries that match a query."""
        matcher = self.matcher(query)
        for entry in self.entries():
            score = matcher.match(f"{entry.text} {entry.help}")
            if score > 0:
                title, help = matcher.highlight(entry.text), literal(entry.help)
                yield Hit(score, title, partial(self.run, entry), help=help)

    async def discover(self) -> Hits:
        """Yield all entries."""
        for entry in self.entries():
            yield DiscoveryHit(entry.text, partial(self.run, entry), help=literal(entry.help))

    def run(self, entry: PaletteEntry) -> None:
        """Run an entry and count its use."""
        ground_app(self.app).palette_uses[entry.text] += 1
        entry.action()

    def entries(self) -> list[PaletteEntry]:
        """Return all entries, those used most first."""
        uses = ground_app(self.app).palette_uses
        return sorted(self.all_entries(), key=lambda entry: -uses[entry.text])

    def all_entries(self) -> Iterator[PaletteEntry]:
        """Yield all entries: keys, those that continue from here first, themes, and commands."""
        app = ground_app(self.app)
        screen = app.base_screen
        following = [] if screen is None else screen.following_keys()
        station = None if screen is None else screen.interface.station
        first = [one.id for one in following]
        keys = [key for key in app.keys_now() if key.id != "palette"]
        keys.sort(key=lambda key: first.index(key.id) if key.id in first else len(first))
        for key in keys:
            why = "" if station is None else refusal_of(key, station)
            words = f"{shown(key.keys)}   {key.description}{f' ({why})' if why else ''}"
            yield PaletteEntry(key.id.replace("-", " "), partial(app.run_chosen, key.id), words)
        for name in THEMES:
            set_theme = partial(app.commands.perform, SetTheme(name=name))
            yield PaletteEntry(f"theme {name}", set_theme, "colours")
        for word, summary in summaries().items():
            yield PaletteEntry(f": {word}", partial(app.begin_line, f"{word} "), summary)


def literal(text: str) -> str:
    """Return a text that Textual's markup shows as it is: its own escape leaves `[DEG]`."""
    return text.replace("[", r"\[")


def ground_app(app: object) -> PaletteApp:
    """Return the app as the palette needs it."""
    assert isinstance(app, PaletteApp), "the palette needs the ground station's app"
    return app
