"""Test the map widget: what it repaints, and its messages of the mouse."""

import asyncio
from collections.abc import Awaitable, Callable
from typing import Self

import pytest
from rich.style import Style
from textual import events
from textual.app import App, ComposeResult
from textual.geometry import Region
from textual.pilot import Pilot

from ground.app.widgets.map import MapWidget, bands
from ground.map.scene import MapScene, MapTarget, RobotMark

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
