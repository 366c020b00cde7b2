"""An accepted command prints what is so now."""

from ground.cli.operate import effect_of
from ground.client.operations.commands import COMMANDS, Arm
from ground.client.results import Accepted, Refused
from protocol.wire.reasons import Reason
from tests.support.each import each


def test_an_accepted_command_names_its_effect() -> None:
    assert effect_of(Arm(), Accepted(14_000_000)) == ": motors armed"


def test_a_refused_command_has_none() -> None:
    assert effect_of(Arm(), Refused(Reason.NO_GOAL, 1)) == ""


@each("command", COMMANDS)
def test_every_plain_command_has_an_effect(command: type[Arm]) -> None:
    assert effect_of(command(), Accepted(1)) != ""
