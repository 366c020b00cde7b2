"""Test that strips which are kept look as if Textual had drawn them."""

import asyncio
from typing import ClassVar

import pytest
from rich.segment import Segment
from textual._styles_cache import StylesCache
from textual.app import App, ComposeResult
from textual.containers import Container
from textual.geometry import Region
from textual.strip import Strip
from textual.widget import Widget

from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import row
from ground.app.widgets.strip_widget import StillContainer


class PlainLines(Lines):
    """Lines that Textual draws in its general way."""

    def render_lines(self, crop: Region) -> list[Strip]:
        self._restyle()
        return Widget.render_lines(self, crop)


class EdgeApp(App[None]):
    CSS: ClassVar[str] = """
    #outer { background: blue; }
    Lines { width: 12; height: 3; border-left: solid red; background: green; }
    .-stopped #outer { border: heavy red; }
    """

    def __init__(self, outer: type[Widget], lines: type[Lines]) -> None:
        super().__init__()
        self._outer, self._lines = outer, lines

    def compose(self) -> ComposeResult:
        with self._outer(id="outer"):
            yield self._lines(id="lines")


def drawn(outer: type[Widget], lines: type[Lines]) -> list[list[Segment]]:
    async def run() -> list[list[Segment]]:
        app, found = EdgeApp(outer, lines), []
        async with app.run_test(size=(30, 8)) as pilot:
            panel = app.query_one("#lines", Lines)
            for step, words in enumerate(("one", "two", "three")):
                panel.show([row(words), row("below")])
                app.screen.set_class(step == 1, "-stopped")
                await pilot.pause()
                strips = app.screen._compositor.render_strips()
                found += [list(Segment.simplify(strip)) for strip in strips]
        return found

    return asyncio.run(run())


def test_kept_strips_equal_the_general_way() -> None:
    assert drawn(StillContainer, Lines) == drawn(Container, PlainLines)


def test_still_container_is_drawn_once(monkeypatch: pytest.MonkeyPatch) -> None:
    names: list[str | None] = []
    general = StylesCache.render_widget

    def note(self: StylesCache, widget: Widget, crop: Region) -> list[Strip]:
        names.append(widget.id)
        return general(self, widget, crop)

    async def run() -> None:
        app = EdgeApp(StillContainer, Lines)
        async with app.run_test(size=(30, 8)) as pilot:
            await pilot.pause()
            monkeypatch.setattr(StylesCache, "render_widget", note)
            for words in ("one", "two"):
                app.query_one("#lines", Lines).show([row(words)])
                await pilot.pause()

    asyncio.run(run())
    assert "outer" not in names
    assert "lines" not in names
