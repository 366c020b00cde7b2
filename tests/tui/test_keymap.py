"""Keys: their table, the action of each on its screens, hints, and the menu of a place."""

import signal
from pathlib import Path

import pytest
from textual.command import CommandList, DiscoveryHit, Hit
from textual.content import Content

from ground.app.chrome.key_bar import keys_when
from ground.app.commands.palette import CommandPalette
from ground.app.input.driver import TerminalDriver
from ground.app.input.keymap import (
    KEYS,
    Keymap,
    Layer,
    Situation,
    as_toml,
    bindings_of,
    clashes,
    key_hints,
    keymap_of,
    load,
)
from ground.app.screens import SCREENS
from ground.app.widgets.command_line import CommandLine
from ground.client.outcomes import Refused
from ground.client.vocabulary import HINTS
from ground.map.drawing import described, measured
from ground.map.scene import Disc, MapScene, Outline
from protocol.wire.reasons import Reason
from runtime.errors import ConfigError
from tests.support.app import FakeStation, driving, entry, staged, status
from tests.support.each import each

BELOW = (Layer.ROBOT, Layer.FLEET, Layer.STATION)


def of(text: str, tmp_path: Path) -> Keymap:
    path = tmp_path / "keys.toml"
    path.write_text(text, encoding="utf-8")
    return load(path)


def test_ids_are_unique() -> None:
    ids = [key.id for key in KEYS]
    assert len(ids) == len(set(ids))


def test_active_ids_never_share_a_key() -> None:
    assert clashes(Keymap()) == []


def test_only_cursor_and_teleop_hide_keys_of_the_robot() -> None:
    below = {word for key in Keymap().of(*BELOW) for word in key.keys}
    for layer in set(Layer) - {Layer.CURSOR, Layer.TELEOP, *BELOW}:
        if layer in (Layer.TYPING, Layer.FILTER):  # keys type text there
            continue
        taken = {word for key in Keymap().of(layer) for word in key.keys}
        assert not taken & below, layer


def test_file_changes_a_key(tmp_path: Path) -> None:
    keymap = of('[keys]\nhold = ["P", "f5"]\n', tmp_path)
    assert keymap["hold"].keys == ("P", "f5")
    assert keymap["resume"].keys == ("r",)


def test_empty_list_removes_a_key(tmp_path: Path) -> None:
    assert of("[keys]\nrtl = []\n", tmp_path)["rtl"].keys == ()


def test_misspelt_id_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"keys\.holdd.*did you mean 'hold'"):
        of('[keys]\nholdd = "P"\n', tmp_path)


def test_unknown_table_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"kees.*did you mean 'keys'"):
        of('[kees]\nhold = "P"\n', tmp_path)


@each("value", ["3", "true", '[""]', "[1]", '""'])
def test_malformed_key_is_refused(value: str, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="not a key"):
        of(f"[keys]\nhold = {value}\n", tmp_path)


def test_used_key_is_refused_with_its_owner(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="'space' is already used by estop-here"):
        of('[keys]\nhold = "space"\n', tmp_path)


def test_two_ids_may_swap_keys(tmp_path: Path) -> None:
    keymap = of('[keys]\nhold = "r"\nresume = "h"\n', tmp_path)
    assert (keymap["hold"].keys, keymap["resume"].keys) == (("r",), ("h",))


def test_stop_key_that_types_a_character_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be used on the command line"):
        of('[keys]\nestop = "!"\n', tmp_path)


def test_value_instead_of_a_table_is_refused() -> None:
    with pytest.raises(ConfigError, match="not a table"):
        keymap_of({"keys": 3}, file="x")


def test_each_key_becomes_a_binding_of_its_id() -> None:
    bindings = bindings_of(Keymap())
    found = {binding.id for _, binding in bindings}
    assert found == {key.id for key in KEYS}
    assert all(binding.priority for _, binding in bindings)


def test_control_space_is_bound_as_terminals_send_it() -> None:
    keys = [key for key, binding in bindings_of(Keymap()) if binding.id == "estop"]
    assert keys == ["f12", "ctrl+space", "ctrl+@"]


def test_more_special_layer_hides_a_key() -> None:
    found = {key.id: key.keys for key in Keymap().of(Layer.CURSOR, Layer.ROBOT)}
    assert "m" in found["map-menu"]
    assert "mode" not in found


def test_cursor_hides_only_robot_keys_that_the_key_bar_names_anew() -> None:
    keymap, named = Keymap(), {one.id for one in keys_when(Situation.CURSOR)}
    robot = {word for key in keymap.of(Layer.ROBOT, Layer.FLEET) for word in key.keys}
    hidden = {word: key.id for key in keymap.of(Layer.CURSOR) for word in key.keys if word in robot}
    assert hidden == {"m": "map-menu"}
    assert set(hidden.values()) <= named


def test_printed_keymap_can_be_loaded(tmp_path: Path) -> None:
    changed = of('[keys]\nhold = ["P", "\\\\"]\n', tmp_path)
    assert of(as_toml(changed), tmp_path).keys == changed.keys


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


async def test_key_runs_its_command_line() -> None:
    async with staged() as stage:
        for id in LINES:
            await stage.press(key_of(id))
        assert stage.commands.given == list(LINES.values())


async def test_key_with_a_dialog_runs_the_choice() -> None:
    async with staged() as stage:
        for id, (choice, _) in CHOICES.items():
            await stage.press(key_of(id), choice)
        assert stage.commands.given == [line for _, line in CHOICES.values()]


async def test_escape_chooses_nothing() -> None:
    async with staged() as stage:
        await stage.press("m", "down", "escape")
        assert stage.commands.given == []


async def test_keys_move_the_map() -> None:
    async with staged() as stage:
        shown = stage.drive.map
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


async def test_explanation_replaces_the_log() -> None:
    async with staged() as stage:
        await stage.press("e")
        assert stage.drive.query_one("#why-below").display
        assert not stage.drive.query_one("#log").display
        await stage.press("e")
        assert stage.drive.query_one("#log").display


async def test_keys_select_the_robots_in_turn() -> None:
    station = driving(FakeStation())
    station.robots_now = ["r1", "r2", "r3"]
    async with staged(station=station) as stage:
        await stage.press("]")
        assert station.robot == "r2"
        await stage.press("[", "[")
        assert station.robot == "r3"
        assert stage.words("prompt") == "r3:"


async def test_key_takes_and_releases_the_lease() -> None:
    async with staged() as stage:
        await stage.press("L")
        assert stage.station.lease.ours
        await stage.press("L")
        assert not stage.station.lease.held


async def test_last_command_is_copied_for_a_shell(monkeypatch: pytest.MonkeyPatch) -> None:
    async with staged() as stage:
        await stage.press("y")
        assert "no command to copy yet" in stage.log()
        await stage.press("h", "y")
        assert stage.app.clipboard == "sidestep hold"


async def test_screen_is_saved_as_a_picture(
    tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    state, here = tmp_path_factory.mktemp("state"), tmp_path_factory.mktemp("here")
    monkeypatch.setenv("XDG_STATE_HOME", str(state))
    monkeypatch.chdir(here)
    folder = state / "sidestep" / "pictures"
    async with staged() as stage:
        await stage.press("Y", "Y")
        assert f"saved {folder / 'sidestep-screen-2.svg'}" in stage.log()
    assert not list(here.iterdir())
    assert {path.name for path in folder.iterdir()} == {
        "sidestep-screen-1.svg",
        "sidestep-screen-2.svg",
    }
    assert "<svg" in (folder / "sidestep-screen-1.svg").read_text(encoding="utf-8")


async def test_key_switches_through_the_themes() -> None:
    async with staged() as stage:
        seen = []
        for _ in range(5):
            await stage.press("T")
            seen.append(stage.app.theme)
        assert seen == ["light", "contrast", "ansi", "mono", "dark"]


async def test_help_lists_only_active_keys() -> None:
    async with staged() as stage:
        await stage.press("?")
        await stage.press("tab", "tab", "tab")
        everywhere = stage.words("help")
        assert "h  stop, keep the goal; needs no lease" in everywhere
        assert "cursor left" not in everywhere
        await stage.press("escape", "G", "?")
        assert "cursor left" in stage.words("help")


async def test_keys_of_the_users_file_are_active_and_shown() -> None:
    keymap = keymap_of({"keys": {"hold": ["P"], "goal": []}}, file="x")
    async with staged((110, 30), keymap=keymap) as stage:
        assert "P Hold" in stage.words("keybar")
        await stage.press("h", "g")
        assert stage.commands.given == []
        await stage.press("P")
        assert stage.commands.given == ["hold"]


async def test_each_id_has_an_action_on_some_screen() -> None:
    """Without an action, the key would do nothing."""
    async with staged() as stage:
        known: set[str] = set()
        for key in SCREEN_KEYS.values():
            await stage.press(key)
            known |= set(stage.app.doable())
        await stage.press(SCREEN_KEYS["params"], "slash", "x", "enter")
        known |= set(stage.app.doable())
        later = {key.id for key in KEYS if key.layer is Layer.REPLAY}
        assert {key.id for key in KEYS} - known <= later


def first_of(results: CommandList) -> str:
    """Return the text of the result that Enter chooses; empty while there is none."""
    return str(results.get_option_at_index(0).prompt) if results.highlighted == 0 else ""


async def test_palette_runs_an_active_key() -> None:
    async with staged() as stage:
        await stage.press("ctrl+p")
        await stage.type("stop, keep")
        results = stage.app.screen.query_one(CommandList)
        await stage.until(lambda: first_of(results).startswith("hold"))
        await stage.press("enter")
        await stage.until(lambda: stage.commands.given)
        assert stage.commands.given == ["hold"]


async def test_palette_shows_brackets_and_what_was_used_first() -> None:
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


async def test_palette_word_starts_a_command_line() -> None:
    async with staged() as stage:
        stage.app.begin_line("param ")
        await stage.redraw()
        assert stage.app.screen.query_one(CommandLine).value == "param "


def test_refusal_names_the_key_in_force() -> None:
    assert Refused(Reason.NOT_ARMED, 0).in_words(key_hints(Keymap())).endswith("(`a` arm)")
    other = keymap_of({"keys": {"arm": "f5", "goal": []}}, file="keys.toml")
    hints = key_hints(other)
    assert Refused(Reason.NOT_ARMED, 0).in_words(hints).endswith("(`f5` arm)")
    assert Reason.NO_GOAL not in hints


def test_an_abort_in_vain_is_not_told_to_set_a_goal() -> None:
    words = Refused(Reason.NOTHING_TO_ABORT, 0).in_words(key_hints(Keymap()))
    assert words == "refused: no goal is active: there is nothing to abort"


def test_refusal_without_a_key_names_the_command() -> None:
    words = Refused(Reason.OUTSIDE_FENCE, 0).in_words(key_hints(Keymap()))
    assert words.endswith("(`:fence show`)")


def test_refusals_in_the_app_name_no_shell_command() -> None:
    hints = key_hints(Keymap())
    assert "G" in hints[Reason.NO_MISSION]
    assert hints[Reason.NO_MISSION].endswith("`:mission upload FILE`")
    assert hints.keys() >= HINTS.keys()
    assert [words for words in hints.values() if "sidestep " in words] == []


ROOM = Outline(((0.0, 0.0), (6.0, 0.0), (6.0, 4.0), (0.0, 4.0)))
BOX = Outline(((2.0, 1.0), (3.0, 1.0), (3.0, 2.0), (2.0, 2.0)))


async def test_right_click_offers_to_drive_there() -> None:
    async with staged() as stage:
        await stage.pilot.click("#map", offset=(12, 6), button=3)
        await stage.redraw()
        assert "go here" in stage.words("choices")
        assert "measure to here" not in stage.words("choices")
        await stage.press("enter")
        assert len(stage.commands.given) == 1
        assert stage.commands.given[0].startswith("goal ")


@each(("number", "line"), [("1", "goal"), ("2", "wp add")])
async def test_key_at_the_cursor_opens_the_menu(number: str, line: str) -> None:
    async with staged() as stage:
        await stage.press("G", "m", number)
        assert stage.commands.given[0].startswith(line)


async def test_menu_measures_and_looks() -> None:
    async with staged() as stage:
        await stage.press("G", "m", "4", "L", "m", "5")
        assert "m at 0° between both places" in stage.log()
        await stage.press("m", "3")
        assert "from the robot" in stage.words("answer")
        await stage.press("m", "5")
        assert "obstacle" in stage.words("answer")


@each(
    ("place", "words"),
    [
        ((2.5, 1.5), "2.5 1.5: in an obstacle"),
        ((3.1, 1.5), "3.1 1.5: at an obstacle 0.10 m away"),
        ((5.0, 2.0), "5 2: nearest obstacle 0.80 m away, older echo"),
        ((4.5, 3.0), "4.5 3: in an obstacle"),
    ],
)
def test_look_names_what_is_there(place: tuple[float, float], words: str) -> None:
    pillar = Disc(4.5, 3.0, 0.3179)
    scene = MapScene(obstacles=(ROOM, BOX, pillar), seen_old=((5.1, 2.0),))
    assert described(scene, place, 0.15) == words


def test_look_at_an_empty_map() -> None:
    assert described(MapScene(), (1.0, 2.0), 0.1) == "1 2: nothing known"


def test_heading_of_a_measurement_is_counter_clockwise_from_x() -> None:
    assert measured((1.0, 1.0), (1.0, 3.0)) == "2.00 m at 90°"


def test_undo_and_suspend_can_exchange_their_keys() -> None:
    keymap = keymap_of({"keys": {"suspend": "ctrl+z", "undo": "alt+z"}}, file="x")
    assert (keymap["suspend"].keys, keymap["undo"].keys) == (("ctrl+z",), ("alt+z",))


@each(("group", "said"), [(7, "no shell waits"), (8, "press alt+z again within 3 s to suspend")])
async def test_suspend_needs_a_shell_and_a_second_press(
    group: int, said: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.getsid", lambda _: 7)
    monkeypatch.setattr("os.getpgrp", lambda: group)
    station = driving(FakeStation())
    station.entries = [entry("r1", status(station.now_ns))]
    async with staged(station=station) as stage:
        suspended: list[int] = []
        stage.app.suspend_to_shell = lambda: suspended.append(1)  # type: ignore[method-assign]
        await stage.press("alt+z")
        assert said in stage.log()
        assert suspended == []
        await stage.press("alt+z")
        assert suspended == [1] * (group == 8)


def test_terminal_is_restored_before_the_whole_job_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    driver, done = TerminalDriver.__new__(TerminalDriver), list[object]()
    driver._auto_restart = True
    monkeypatch.setattr(driver, "suspend_application_mode", lambda: done.append("restored"))
    monkeypatch.setattr("os.kill", lambda *_: done.append("only this process"))
    monkeypatch.setattr("os.killpg", lambda *how: done.append(how))
    driver._sigtstp_application()
    assert done == ["restored", (0, signal.SIGSTOP)]
