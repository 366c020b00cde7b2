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
SECTIONS: Final = (DRIVE, LOOK, TEST, RUN, REC, MORE)
"""In the order of `sidestep --help`."""
GROUPS: Final[Mapping[str, str]] = MappingProxyType(
    {
        RUN: "one: plant, robot, router, gateway, container, health, bridge",
        REC: "recordings: start, list, mark, export, plot, reexecute",
    }
)
"""Verbs of these sections are below their group, as in `sidestep rec plot`."""


class Subcommand(NamedTuple):
    """A subcommand of a verb.

    `example` is a command line without `sidestep`. `module` is given if the subcommand is a program
    with a `parser` of its own.
    """

    summary: str
    example: str
    module: str = ""


class Verb(NamedTuple):
    """A verb, with the names of its module and of the functions in it.

    `section` is a heading of the help, or the group that the verb belongs to. `example` is a
    command line without `sidestep`. `words` is the class that parses a typed operation, for the
    shell and for the app's command line. Other verbs of an operator parse `arguments` and then
    either run by themselves (`run`) or act over a link to a robot (`act`). A verb with none of
    these is a program with a `main` and a `parser`. `name` is the word in the group, if it is not
    the key of the table; `suffixes` are those of its argument `file`, and `subcommands` the words
    that follow the verb, as in `mission upload`; `hosts` are modules that register where a program
    can run, by the option that needs them. `rank` orders the verbs of a section.
    """

    section: str
    summary: str
    example: str
    module: str
    act: str = ""
    run: str = ""
    arguments: str = "arguments"
    words: str = ""
    name: str = ""
    suffixes: tuple[str, ...] = ()
    subcommands: Mapping[str, Subcommand] = MappingProxyType({})
    hosts: Mapping[str, str] = MappingProxyType({})
    rank: int = 0

    @property
    def is_program(self) -> bool:
        """True for a verb whose module has its own `main`."""
        return not (self.act or self.run or self.words)

    @property
    def is_grouped(self) -> bool:
        """True for a verb below a group."""
        return self.section in GROUPS
