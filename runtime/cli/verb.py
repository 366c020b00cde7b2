"""A row of the table of verbs, and the sections of the table."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final, NamedTuple

DRIVE: Final = "start and drive"
LOOK: Final = "look"
TEST: Final = "test"
RUN: Final = "run"
REC: Final = "rec"
MORE: Final = "groups"
APP: Final = "app"
"""The section of the verbs that only the app has; they are not in the table."""
SECTIONS: Final = (DRIVE, LOOK, TEST, RUN, REC, MORE)
"""In the order of `sidestep --help`."""
GROUPS: Final[Mapping[str, str]] = MappingProxyType(
    {
        RUN: "plant, robot, router, gateway, container, health, bridge, ros2",
        REC: "recordings: start, list, mark, export, plot, reexecute",
    }
)
"""Verbs of these sections are below their group, as in `sidestep rec plot`."""


class Subcommand(NamedTuple):
    """A subcommand of a verb.

    `example` is a command line without `sidestep`. `module` is given if the subcommand is a program
    with a `parser` of its own. `also` as in `Verb`.
    """

    summary: str
    example: str
    module: str = ""
    also: Mapping[str, tuple[str, ...]] = MappingProxyType({})


class Verb(NamedTuple):
    """A verb, with the names of its module and of the functions in it.

    `section` is a heading of the help, or the group that the verb belongs to. `example` is a
    command line without `sidestep`. `words` is the class that parses a typed operation, for the
    shell and for the app's command line. Other verbs of an operator parse `arguments` and then
    `run`. A verb with none of these is a program with a `main` and a `parser`. `name` is the word
    in the group, if it is not the key of the table; `suffixes` are those of its argument `file`,
    and `subcommands` the words that follow the verb, as in `mission upload`; `hosts` are modules
    that register where a program can run, by the option that needs them. `rank` orders the verbs of
    a section. `also` are other words for it in the app, each with the arguments that it stands for;
    `elsewhere` is why the app does not have it, and `only_stops` is True if it can only stop a
    robot.
    """

    section: str
    summary: str
    example: str
    module: str
    run: str = ""
    arguments: str = "arguments"
    words: str = ""
    name: str = ""
    suffixes: tuple[str, ...] = ()
    subcommands: Mapping[str, Subcommand] = MappingProxyType({})
    hosts: Mapping[str, str] = MappingProxyType({})
    rank: int = 0
    also: Mapping[str, tuple[str, ...]] = MappingProxyType({})
    elsewhere: str = "run it in another terminal"
    only_stops: bool = False

    @property
    def is_program(self) -> bool:
        """True for a verb whose module has its own `main`."""
        return not (self.run or self.words)

    @property
    def is_grouped(self) -> bool:
        """True for a verb below a group."""
        return self.section in GROUPS
