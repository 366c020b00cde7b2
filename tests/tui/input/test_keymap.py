"""Test the table of keys, and what a user's file may change."""

from pathlib import Path

import pytest

from ground.app.chrome.key_bar import CURSOR
from ground.app.input.keymap import (
    KEYS,
    Keymap,
    Layer,
    as_toml,
    bindings_of,
    clashes,
    keymap_of,
    load,
)
from runtime.errors import ConfigError

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


@pytest.mark.parametrize("value", ["3", "true", '[""]', "[1]", '""'])
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
    keymap, named = Keymap(), {one.id for one in CURSOR}
    robot = {word for key in keymap.of(Layer.ROBOT, Layer.FLEET) for word in key.keys}
    hidden = {word: key.id for key in keymap.of(Layer.CURSOR) for word in key.keys if word in robot}
    assert hidden == {"m": "map-menu"}
    assert set(hidden.values()) <= named


def test_printed_keymap_can_be_loaded(tmp_path: Path) -> None:
    changed = of('[keys]\nhold = ["P", "\\\\"]\n', tmp_path)
    assert of(as_toml(changed), tmp_path).keys == changed.keys
