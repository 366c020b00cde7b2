"""The widgets of the app: the map, strips that are kept, and how the Drive screen is shared."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import ClassVar, Self

import pytest
from rich.segment import Segment
from rich.style import Style
from textual import events
from textual._styles_cache import StylesCache
from textual.app import App, ComposeResult
from textual.containers import Container
from textual.geometry import Region
from textual.pilot import Pilot
from textual.strip import Strip
from textual.widget import Widget

from ground.app.screens.drive import LEAST_MAP, drive_layout
from ground.app.widgets.lines import Lines
from ground.app.widgets.map import MapWidget, bands
from ground.app.widgets.rows import row
from ground.app.widgets.strip_widget import StillContainer
from ground.map.canvas import DOTS_HIGH, DOTS_WIDE
from ground.map.scene import MapScene, MapTarget, RobotMark, View
from tests.support.each import each

STYLES = {"robot": Style(color="yellow", bold=True), "truth": Style(color="white")}
ROOM = MapScene(size_m=(6.0, 4.0), robot=RobotMark(2.02, 2.02, 0.0, 0.12), goal=MapTarget(5.0, 3.0))


class CountingMap(MapWidget):
    """Counts the regions that it was asked to paint again."""

    def __init__(self, ascii_only: bool) -> None:
        super().__init__({} if ascii_only else STYLES, ascii_only)
        self.regions: list[Region] = []
        self.whole = 0

    def refresh(
        self,
        *regions: Region,
        repaint: bool = True,
        layout: bool = False,
        recompose: bool = False,
    ) -> Self:
        if self.is_attached and not layout:
            self.regions += regions
            self.whole += not regions
        return super().refresh(*regions, repaint=repaint, layout=layout, recompose=recompose)


class MapApp(App[None]):
    def __init__(self, ascii_only: bool = False) -> None:
        super().__init__()
        self.map = CountingMap(ascii_only)
        self.pointed: list[tuple[float, float]] = []
        self.zoomed: list[float] = []

    def compose(self) -> ComposeResult:
        yield self.map

    def on_map_widget_pointed(self, message: MapWidget.Pointed) -> None:
        self.pointed.append((message.x_m, message.y_m))

    def on_map_widget_zoomed(self, message: MapWidget.Zoomed) -> None:
        self.zoomed.append(message.factor)


def on_screen(
    story: Callable[[MapApp, Pilot[None]], Awaitable[None]],
    size: tuple[int, int] = (50, 16),
    *,
    ascii_only: bool = False,
) -> None:
    async def run() -> None:
        app = MapApp(ascii_only)
        async with app.run_test(size=size) as pilot:
            app.map.show(ROOM)
            await pilot.pause()
            app.map.regions.clear()
            app.map.whole = 0
            await story(app, pilot)

    asyncio.run(run())


def screen(app: MapApp) -> list[str]:
    return [strip.text for strip in app.screen._compositor.render_strips()]


def test_equal_picture_paints_nothing() -> None:
    async def story(app: MapApp, pilot: Pilot[None]) -> None:
        app.map.show(
            MapScene(
                size_m=(6.0, 4.0), robot=RobotMark(2.02, 2.02, 1e-9, 0.12), goal=MapTarget(5.0, 3.0)
            )
        )
        assert (app.map.regions, app.map.whole) == ([], 0)

    on_screen(story)


def test_only_changed_rows_are_painted_again() -> None:
    async def story(app: MapApp, pilot: Pilot[None]) -> None:
        app.map.show(
            MapScene(
                size_m=(6.0, 4.0), robot=RobotMark(2.5, 2.0, 0.0, 0.12), goal=MapTarget(5.0, 3.0)
            )
        )
        assert app.map.whole == 0
        assert 0 < sum(region.height for region in app.map.regions) <= 4
        assert all(region.width == 50 for region in app.map.regions)

    on_screen(story)


def test_partial_painting_equals_full_painting() -> None:
    async def story(app: MapApp, pilot: Pilot[None]) -> None:
        for x_m in (2.5, 3.0, 3.5):
            app.map.show(MapScene(size_m=(6.0, 4.0), robot=RobotMark(x_m, 2.0, 0.0, 0.12)))
            await pilot.pause()
        painted = screen(app)
        app.map.colour(STYLES)
        await pilot.pause()
        assert screen(app) == painted
        assert sum("▶" in row for row in painted[:-1]) == 1

    on_screen(story)


def test_map_is_dim_when_the_robot_is_not_live() -> None:
    async def story(app: MapApp, pilot: Pilot[None]) -> None:
        def styles() -> list[Style]:
            rows = [app.map.render_line(row) for row in range(16)]
            return [s.style for row in rows for s in row if s.style is not None]

        assert STYLES["robot"] in styles()
        app.map.show(MapScene(size_m=(6.0, 4.0), robot=RobotMark(2.0, 2.0, 0.0, 0.12), live=False))
        assert all(style.dim for style in styles())
        assert any("?" in app.map.render_line(row).text for row in range(16))

    on_screen(story)


def test_click_and_wheel_send_messages() -> None:
    async def story(app: MapApp, pilot: Pilot[None]) -> None:
        view = app.map.view
        await pilot.click(CountingMap, offset=(10, 5))
        await pilot._post_mouse_events([events.MouseScrollUp], CountingMap)
        assert app.pointed == [view.middle_of(10, 5)]
        assert app.zoomed == [1.25]

    on_screen(story)


def test_zooming_and_fitting_replace_each_other() -> None:
    async def story(app: MapApp, pilot: Pilot[None]) -> None:
        fitted = app.map.view
        app.map.zoom(2.0, (2.0, 2.0))
        assert not app.map.fitted
        assert app.map.view.m_per_dot == fitted.m_per_dot / 2.0
        app.map.centre(3.0, 0.0)
        app.map.fit()
        assert app.map.view == fitted

    on_screen(story)


def test_following_keeps_the_robot_on_the_map() -> None:
    async def story(app: MapApp, pilot: Pilot[None]) -> None:
        app.map.zoom(8.0)
        app.map.following = True
        for step in range(20):
            app.map.show(MapScene(size_m=(6.0, 4.0), robot=RobotMark(0.3 * step, 2.0, 0.0, 0.12)))
            column, row = app.map.view.cell_of(0.3 * step, 2.0) or (-1, -1)
            assert 0 <= column < 50
            assert 0 <= row < 16

    on_screen(story)


def test_map_takes_any_size() -> None:
    async def story(app: MapApp, pilot: Pilot[None]) -> None:
        for size in ((1, 1), (20, 5), (300, 90), (3, 40), (50, 16)):
            await pilot.resize_terminal(*size)
            await pilot.pause()
            assert [len(row) for row in screen(app)] == [size[0]] * size[1]

    on_screen(story)


def test_layers_are_switched_by_name() -> None:
    async def story(app: MapApp, pilot: Pilot[None]) -> None:
        app.map.shown_layers = {"robot"}
        await pilot.pause()
        assert "goal" not in "".join(screen(app))
        assert "▶" in "".join(screen(app))

    on_screen(story)


def test_map_is_painted_without_colour_and_braille() -> None:
    async def story(app: MapApp, pilot: Pilot[None]) -> None:
        assert "".join(screen(app)).isascii()
        assert ">" in "".join(screen(app))

    on_screen(story, ascii_only=True)


def test_neighbouring_rows_are_one_region() -> None:
    assert bands([2], 9) == [Region(0, 2, 9, 1)]
    assert bands([0, 1, 2, 5, 7, 8], 9) == [
        Region(0, 0, 9, 3),
        Region(0, 5, 9, 1),
        Region(0, 7, 9, 2),
    ]


def test_unbounded_map_is_not_fitted_at_every_step() -> None:
    async def story(app: MapApp, pilot: Pilot[None]) -> None:
        views = []
        for step in range(200):
            trail = tuple((0.03 * i, 0.01 * i) for i in range(step + 1))
            app.map.show(MapScene(trail=trail, robot=RobotMark(*trail[-1], 0.3, 0.12)))
            views.append(app.map.view)
        assert 1 < len(set(views)) < 15

    on_screen(story)


def test_another_world_is_fitted_at_once() -> None:
    async def story(app: MapApp, pilot: Pilot[None]) -> None:
        app.map.show(MapScene(size_m=(2.0, 1.0)))
        small = app.map.view
        app.map.show(MapScene(size_m=(20.0, 10.0)))
        assert app.map.view.m_per_dot > 5.0 * small.m_per_dot

    on_screen(story)


def test_map_is_painted_with_no_color(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")

    async def story(app: MapApp, pilot: Pilot[None]) -> None:
        app.map.show(MapScene(size_m=(6.0, 4.0), robot=RobotMark(3.0, 2.0, 0.0, 0.12)))
        await pilot.pause()
        assert any("▶" in row for row in screen(app))
        assert app.no_color

    on_screen(story)


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


async def test_still_container_is_drawn_once(monkeypatch: pytest.MonkeyPatch) -> None:
    names: list[str | None] = []
    general = StylesCache.render_widget

    def note(self: StylesCache, widget: Widget, crop: Region) -> list[Strip]:
        names.append(widget.id)
        return general(self, widget, crop)

    app = EdgeApp(StillContainer, Lines)
    async with app.run_test(size=(30, 8)) as pilot:
        await pilot.pause()
        monkeypatch.setattr(StylesCache, "render_widget", note)
        for words in ("one", "two"):
            app.query_one("#lines", Lines).show([row(words)])
            await pilot.pause()
    assert "outer" not in names
    assert "lines" not in names


CONTENT = ((80, 20), (120, 36), (200, 56))
"""Columns and rows between tabs and command line at 80x24, 120x40 and 200x60."""


def empty_share(columns: int, rows: int, floor_m: tuple[float, float]) -> float:
    """Return the share of the map, legend excluded, that the floor does not cover."""
    layout = drive_layout(columns, rows, floor_m)
    map_rows = rows if layout.beside else rows - layout.lower_rows
    view = View.fit((0.0, 0.0, *floor_m), layout.map_columns, map_rows)
    floor_dots = floor_m[0] * floor_m[1] / view.m_per_dot**2
    return 1.0 - floor_dots / (DOTS_WIDE * layout.map_columns * DOTS_HIGH * (map_rows - 1))


@each(("columns", "rows"), CONTENT)
@each("floor_m", [(6.0, 6.0), (7.0, 7.0), (6.0, 5.0), (5.0, 4.0)])
def test_square_worlds_leave_little_of_the_map_empty(
    columns: int, rows: int, floor_m: tuple[float, float]
) -> None:
    assert empty_share(columns, rows, floor_m) < 0.3


@each(("columns", "rows"), CONTENT)
def test_log_is_beside_the_map_where_there_is_room(columns: int, rows: int) -> None:
    assert drive_layout(columns, rows, (7.0, 7.0)).beside == (columns >= 120)


@each("floor_m", [None, (0.0, 4.0), (40.0, 1.0), (1.0, 40.0)])
@each("columns", [1, 60, 80, 120, 300])
@each("rows", [1, 14, 20, 36, 90])
@each("explaining", [False, True])
def test_any_size_has_a_layout(
    columns: int, rows: int, floor_m: tuple[float, float] | None, explaining: bool
) -> None:
    layout = drive_layout(columns, rows, floor_m, explaining=explaining)
    assert layout.map_columns >= LEAST_MAP
    assert layout.lower_rows >= (11 if explaining else 4)
