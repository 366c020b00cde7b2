"""`help` lists all commands, or the arguments of one."""

import pytest

from ground.console.help import help_text
from ground.console.parser import verbs
from runtime.errors import UserError
from tests.support.each import each


def test_every_command_is_in_the_list() -> None:
    words = set(help_text().replace(",", "").split())
    assert set(verbs()) <= words
    assert "router" not in words


def test_one_command_is_explained_by_its_short_name_too() -> None:
    text = help_text("goal")
    assert text.startswith("goto [--tolerance M]")
    assert "final heading" in text
    assert "--connect" not in text


@each("word", verbs())
def test_each_command_can_be_explained(word: str) -> None:
    assert help_text(word)


def test_help_for_what_is_not_there_offers_what_is() -> None:
    with pytest.raises(UserError, match="did you mean 'goto'"):
        help_text("gotto")
