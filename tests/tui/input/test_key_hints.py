"""A refusal in the app names keys: those of the keymap in force."""

from ground.app.input.keymap import Keymap, key_hints, keymap_of
from ground.client.results import Refused
from ground.client.vocabulary import HINTS
from protocol.wire.reasons import Reason


def test_refusal_names_the_key_in_force() -> None:
    assert Refused(Reason.NOT_ARMED, 0).in_words(key_hints(Keymap())).endswith("(`a` arm)")
    other = keymap_of({"keys": {"arm": "f5", "goal": []}}, file="keys.toml")
    hints = key_hints(other)
    assert Refused(Reason.NOT_ARMED, 0).in_words(hints).endswith("(`f5` arm)")
    assert Reason.NO_GOAL not in hints


def test_refusal_without_a_key_names_the_command() -> None:
    words = Refused(Reason.OUTSIDE_FENCE, 0).in_words(key_hints(Keymap()))
    assert words.endswith("(`:fence show`)")


def test_refusals_in_the_app_name_no_shell_command() -> None:
    hints = key_hints(Keymap())
    assert "G" in hints[Reason.NO_MISSION]
    assert hints[Reason.NO_MISSION].endswith("`:mission upload FILE`")
    assert hints.keys() >= HINTS.keys()
    assert [words for words in hints.values() if "sidestep " in words] == []
