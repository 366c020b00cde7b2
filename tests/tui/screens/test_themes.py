"""Test that every switch of the theme repaints every screen."""

from collections.abc import Iterator
from itertools import pairwise, permutations

import pytest
from rich.style import Style

from ground.app.screens.drive import DriveScreen
from ground.app.widgets.map import MapWidget
from ground.text.theme_names import THEMES
from tests.support.tui.pilot import Stage, play, staged

PAIRS = tuple(permutations(THEMES, 2))
SCREENS = "12345678"
Row = list[tuple[str, Style | None]]


def chain() -> Iterator[str]:
    """Yield themes so that each ordered pair of themes is next to each other once."""
    left = {theme: [other for other in THEMES if other != theme] for theme in THEMES}
    here, way = THEMES[0], list[str]()
    back: list[str] = []
    while here or back:
        if left[here]:
            back.append(here)
            here = left[here].pop()
            continue
        way.append(here)
        if not back:
            break
        here = back.pop()
    yield from reversed(way)


def styles(stage: Stage) -> list[Row]:
    """Return what the terminal shows: the text of each segment with its style."""
    strips = stage.app.screen._compositor.render_strips()
    return [[(segment.text, segment.style) for segment in strip.simplify()] for strip in strips]


async def settled(stage: Stage) -> list[Row]:
    """Draw until nothing changes any more: Textual lays out a new screen in several frames."""
    before, found = None, styles(stage)
    while found != before:
        await stage.redraw()
        before, found = found, styles(stage)
    return found


def differing(found: list[Row], wanted: list[Row]) -> list[tuple[Row, Row]]:
    return [pair for pair in zip(found, wanted, strict=True) if pair[0] != pair[1]][:1]


async def switch(stage: Stage, theme: str) -> None:
    """Switch as the app does: a frame is drawn at once, before Textual applies the style sheet."""
    stage.app.theme = theme
    stage.app.redraw()
    styles(stage)
    await stage.redraw()


def test_chain_holds_every_pair_of_themes() -> None:
    themes = list(chain())
    assert set(pairwise(themes)) == set(PAIRS)


@pytest.mark.sweep(2)
@pytest.mark.parametrize("size", [(80, 24), (160, 50)], ids=str)
def test_map_takes_the_background_of_every_next_theme(size: tuple[int, int]) -> None:
    async def story() -> None:
        themes = list(chain())
        async with staged(size, theme=themes[0]) as stage:
            for theme in themes[1:]:
                await switch(stage, theme)
                assert isinstance(stage.app.screen, DriveScreen)
                for shown in stage.app.screen.query(MapWidget):
                    wanted = shown.rich_style.bgcolor
                    strips = [shown.render_line(row) for row in range(shown.size.height)]
                    found = {one.style.bgcolor for strip in strips for one in strip if one.style}
                    assert found <= {wanted}, theme

    play(story)


@pytest.mark.usefixtures("worlds")
@pytest.mark.sweep(2)
@pytest.mark.parametrize("switches", [4, len(PAIRS)])
def test_switched_theme_looks_like_a_fresh_start_on_every_screen(switches: int) -> None:
    async def story() -> None:
        themes = list(chain())[: switches + 1]
        turns = [
            (theme, (SCREENS[turn % len(SCREENS)], SCREENS[(turn + 3) % len(SCREENS)]))
            for turn, theme in enumerate(themes[1:])
        ]
        wanted = {(theme, key) for theme, keys in turns for key in keys}
        fresh = {}
        for one in {theme for theme, _ in turns}:
            async with staged(theme=one) as stage:
                for key in SCREENS:
                    if (one, key) in wanted:
                        await stage.press(key)
                        fresh[one, key] = await settled(stage)
        async with staged(theme=themes[0]) as stage:
            for theme, keys in turns:
                await stage.press(keys[0])
                await switch(stage, theme)
                for key in keys:
                    await stage.press(key)
                    assert differing(await settled(stage), fresh[theme, key]) == [], (theme, key)

    play(story)
