"""What an operator may be called."""

import pytest

from ground.cli.command.lease import named
from protocol.wire.limits import MAX_OPERATOR_NAME_BYTES
from runtime.errors import UserError


def test_without_a_name_it_is_that_of_the_user() -> None:
    assert 0 < len(named(None).encode()) <= MAX_OPERATOR_NAME_BYTES


def test_a_name_is_taken_as_it_is() -> None:
    assert named("Änne") == "Änne"


@pytest.mark.parametrize("name", ["", "a" * 17, "ä" * 9, "a\nb", "\x1b[2J"])
def test_what_does_not_fit_or_cannot_be_shown_is_no_name(name: str) -> None:
    with pytest.raises(UserError, match="is no name for an operator"):
        named(name)
