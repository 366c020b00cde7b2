"""Test that each key id runs its action on the screens where it is active."""

import pytest
from textual.command import CommandList, DiscoveryHit, Hit
from textual.content import Content

from ground.app.commands.palette import CommandPalette
from ground.app.input.keymap import KEYS, Keymap, Layer, keymap_of
from ground.app.screens import SCREENS
from ground.app.screens.drive import DriveScreen
from ground.app.widgets.command_line import CommandLine
from tests.support.tui.fakes import FakeStation
from tests.support.tui.pilot import Stage, play, staged
from tests.support.tui.underway import driving

LINES = {
    "hold": "hold",
    "resume": "resume",
    "abort": "abort",
    "arm": "arm",
    "disarm": "disarm",
    "rtl": "rtl",
    "missions": "mission list",
}
CHOICES = {
    "mode": ("1", "mode manual"),
    "navigator": ("3", "navigator bug1"),
    "side": ("2", "navigator vgm right"),
}
SCREEN_KEYS = {name: str(number) for name, number in SCREENS.items()}


def key_of(id: str) -> str:
    return Keymap()[id].keys[0]


def test_key_runs_its_command_line() -> None:
    async def story() -> None:
        async with staged() as stage:
            for id in LINES:
                await stage.press(key_of(id))
            assert stage.commands.given == list(LINES.values())

    play(story)


def test_key_with_a_dialog_runs_the_choice() -> None:
    async def story() -> None:
        async with staged() as stage:
            for id, (choice, _) in CHOICES.items():
                await stage.press(key_of(id), choice)
            assert stage.commands.given == [line for _, line in CHOICES.values()]

    play(story)


def test_escape_chooses_nothing() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("m", "down", "escape")
            assert stage.commands.given == []

    play(story)


def drive_of(stage: Stage) -> DriveScreen:
    assert isinstance(stage.app.screen, DriveScreen)
    return stage.app.screen


def test_keys_move_the_map() -> None:
    async def story() -> None:
        async with staged() as stage:
            shown = drive_of(stage).map
            scale_m = shown.view.m_per_dot
            await stage.press("+")
            assert shown.view.m_per_dot == pytest.approx(scale_m / 1.25)
            await stage.press("minus", "minus")
            assert shown.view.m_per_dot == pytest.approx(scale_m * 1.25)
            await stage.press("c")
            assert shown.view.centre_x_m == pytest.approx(4.12)
            await stage.press("0")
            assert shown.fitted
            await stage.press("f")
            assert shown.following
            await stage.press("z", "down", "enter")
            assert "seen" not in shown.shown_layers

    play(story)


def test_explanation_replaces_the_log() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("e")
            assert drive_of(stage).query_one("#why-below").display
            assert not drive_of(stage).query_one("#log").display
            await stage.press("e")
            assert drive_of(stage).query_one("#log").display

    play(story)


def test_keys_select_the_robots_in_turn() -> None:
    async def story() -> None:
        station = driving(FakeStation())
        station.robots_now = ["r1", "r2", "r3"]
        async with staged(station=station) as stage:
            await stage.press("]")
            assert station.robot == "r2"
            await stage.press("[", "[")
            assert station.robot == "r3"
            assert stage.words("prompt") == "r3:"

    play(story)


def test_key_takes_and_releases_the_lease() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("L")
            assert stage.station.lease.ours
            await stage.press("L")
            assert not stage.station.lease.held

    play(story)


def test_last_command_is_copied_for_a_shell(monkeypatch: pytest.MonkeyPatch) -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("y")
            assert "no command to copy yet" in stage.log()
            await stage.press("h", "y")
            assert stage.app.clipboard == "sidestep hold"

    play(story)


def test_screen_is_saved_as_a_picture(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    state, here = tmp_path_factory.mktemp("state"), tmp_path_factory.mktemp("here")
    monkeypatch.setenv("XDG_STATE_HOME", str(state))
    monkeypatch.chdir(here)
    folder = state / "sidestep" / "pictures"

    async def story() -> None:
        async with staged() as stage:
            await stage.press("Y", "Y")
            assert f"saved {folder / 'sidestep-2.svg'}" in stage.log()

    play(story)
    assert not list(here.iterdir())
    assert {path.name for path in folder.iterdir()} == {"sidestep-1.svg", "sidestep-2.svg"}
    assert "<svg" in (folder / "sidestep-1.svg").read_text(encoding="utf-8")


def test_key_switches_through_the_themes() -> None:
    async def story() -> None:
        async with staged() as stage:
            seen = []
            for _ in range(5):
                await stage.press("T")
                seen.append(stage.app.theme)
            assert seen == ["light", "contrast", "ansi", "mono", "dark"]

    play(story)


def test_help_lists_only_active_keys() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("?")
            await stage.press("tab", "tab", "tab")
            everywhere = stage.words("help")
            assert "h  stop, keep the goal; needs no lease" in everywhere
            assert "cursor left" not in everywhere
            await stage.press("escape", "G", "?")
            assert "cursor left" in stage.words("help")

    play(story)


def test_keys_of_the_users_file_are_active_and_shown() -> None:
    async def story() -> None:
        keymap = keymap_of({"keys": {"hold": ["P"], "goal": []}}, file="x")
        async with staged((110, 30), keymap=keymap) as stage:
            assert "P Hold" in stage.words("keybar")
            await stage.press("h", "g")
            assert stage.commands.given == []
            await stage.press("P")
            assert stage.commands.given == ["hold"]

    play(story)


def test_each_id_has_an_action_on_some_screen() -> None:
    """Without an action, the key would do nothing."""

    async def story() -> None:
        async with staged() as stage:
            known: set[str] = set()
            for key in SCREEN_KEYS.values():
                await stage.press(key)
                known |= set(stage.app.doable())
            await stage.press(SCREEN_KEYS["params"], "slash", "x", "enter")
            known |= set(stage.app.doable())
            later = {key.id for key in KEYS if key.layer is Layer.REPLAY}
            assert {key.id for key in KEYS} - known <= later

    play(story)


def first_of(results: CommandList) -> str:
    """Return the text of the result that Enter chooses; empty while there is none."""
    return str(results.get_option_at_index(0).prompt) if results.highlighted == 0 else ""


def test_palette_runs_an_active_key() -> None:
    async def story() -> None:
        async with staged() as stage:
            await stage.press("ctrl+p")
            await stage.type("stop, keep")
            results = stage.app.screen.query_one(CommandList)
            await stage.until(lambda: first_of(results).startswith("hold"))
            await stage.press("enter")
            await stage.until(lambda: stage.commands.given)
            assert stage.commands.given == ["hold"]

    play(story)


def test_palette_shows_brackets_and_what_was_used_first() -> None:
    async def story() -> None:
        async with staged() as stage:
            provider = CommandPalette(stage.app.screen)
            hits = [hit async for hit in provider.discover() if isinstance(hit, DiscoveryHit)]
            goto = next(hit for hit in hits if hit.display == ": goto")
            assert goto.help is not None
            assert "X Y [DEG]" in Content.from_markup(goto.help).plain
            found = [hit async for hit in provider.search(": goto") if isinstance(hit, Hit)]
            assert any("X Y [DEG]" in Content.from_markup(hit.help or "").plain for hit in found)
            assert hits[0].display == "hold"
            goto.command()
            hits = [hit async for hit in provider.discover() if isinstance(hit, DiscoveryHit)]
            assert hits[0].display == ": goto"

    play(story)


def test_palette_word_starts_a_command_line() -> None:
    async def story() -> None:
        async with staged() as stage:
            stage.app.begin_line("param ")
            await stage.redraw()
            assert stage.app.screen.query_one(CommandLine).value == "param "

    play(story)
