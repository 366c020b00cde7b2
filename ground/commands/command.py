"""A command is one class: its fields are its arguments, its docstring is its help.

From the class follow the parser of the shell and of the app's line, the line that would be typed
for a value, and its row in `runtime/cli/command_index.py`, which `make generate` writes.
"""

import argparse
import shlex
from collections.abc import Callable, Iterable, Mapping
from dataclasses import MISSING, dataclass, field, fields
from importlib import import_module
from types import MappingProxyType
from typing import (
    Any,
    ClassVar,
    Final,
    Literal,
    NamedTuple,
    TypeAlias,
    TypeVar,
    dataclass_transform,
)

from ground.client.connection import LONGEST_S
from protocol.options import CONFIG_HELP, DEFAULT_ENDPOINT, above_zero, up_to
from runtime.cli.parsers import add_subcommands
from runtime.cli.verb import GROUPS, Subcommand, Verb
from runtime.cli.verb_table import VERBS

T = TypeVar("T")
DIGITS: Final = 9
"""Digits after the point: more would show rounding errors of the conversion to degrees."""
positive: Final = above_zero()
seconds: Final = above_zero(LONGEST_S)
moment: Final = up_to(LONGEST_S)
After: TypeAlias = Literal["", "json", "seize"]
"""The shared option that an argument follows in the help; without one it precedes them all."""


class Argument(NamedTuple):
    """How a field is typed: after one of its `flags`, or without one in its place.

    `names` are the words for its values; `joined` makes the value of all words that follow.
    `meanings` are words that the completion offers, each with its meaning.
    """

    flags: tuple[str, ...]
    how: Mapping[str, Any]
    after: After = ""
    names: Mapping[str, Any] | None = None
    joined: Callable[[list[Any]], Any] | None = None
    spelt: Callable[[Any], str] | None = None
    meanings: Mapping[str, str] = MappingProxyType({})

    def add_to(self, parser: argparse.ArgumentParser, name: str) -> None:
        """Declare the argument; one that is not given is None."""
        how = dict(self.how)
        if callable(how["help"]):
            how["help"] = how["help"]()
        if self.flags:
            action = parser.add_argument(*self.flags, dest=name, **how)
        else:
            action = parser.add_argument(name, **how)
        vars(action)["meanings"] = self.meanings

    def value(self, given: Any) -> Any:
        """Return the value of the field for what argparse has parsed."""
        if self.names is not None:
            return self.names[given]
        return given if self.joined is None else self.joined(given)

    def words(self, value: Any) -> str:
        """Return a value as it is typed."""
        flag = f"{self.flags[0]} " if self.flags else ""
        if isinstance(value, bool):
            return self.flags[0]
        if self.names is not None:
            return flag + next(name for name, one in self.names.items() if one == value)
        if self.spelt is not None:
            return flag + self.spelt(value)
        return flag + (number(value) if isinstance(value, float) else shlex.quote(str(value)))


def number(value: float) -> str:
    """Format a number with enough digits to parse it back."""
    return f"{round(value, DIGITS):g}"


def argument(default: Any, *parts: Any, **named: Any) -> Any:
    """Return a field of a command."""
    return field(default=default, metadata={"argument": Argument(*parts, **named)})


def place(
    metavar: str,
    help: str | Callable[[], str] | None = None,
    *,
    default: Any = MISSING,
    optional: bool = False,
    parse: Callable[[str], Any] = str,
    joined: Callable[[list[Any]], Any] | None = None,
    spelt: Callable[[Any], str] | None = None,
    meanings: Mapping[str, str] = MappingProxyType({}),
) -> Any:
    """Return a field that is typed without a flag; with a default it may be left out.

    So may one that is `optional`: then the class overrides `parsed`, which knows the value.
    `joined` makes the value of one or more words; a `help` that depends on the user is a function.
    """
    how: dict[str, Any] = {"metavar": metavar, "help": help, "type": parse}
    if joined is not None:
        how["nargs"] = "+" if default is MISSING else "*"
    elif optional or default is not MISSING:
        how["nargs"] = "?"
    return argument(default, (), how, joined=joined, spelt=spelt, meanings=meanings)


def option(
    *flags: str,
    default: Any,
    help: str,
    metavar: str | tuple[str, ...],
    parse: Callable[[str], Any] = str,
    joined: Callable[[list[Any]], Any] | None = None,
    spelt: Callable[[Any], str] | None = None,
    after: After = "",
) -> Any:
    """Return a field that is typed after a flag; of several words `joined` makes the value."""
    how: dict[str, Any] = {"metavar": metavar, "help": help, "type": parse}
    if isinstance(metavar, tuple):
        how["nargs"] = len(metavar)
    return argument(default, flags, how, after, joined=joined, spelt=spelt)


def switch(flag: str, *, default: bool, help: str, after: After = "") -> Any:
    """Return a field that has the other value if its flag is given."""
    how = {"action": "store_const", "const": not default, "default": default, "help": help}
    return argument(default, (flag,), how, after)


def choice(
    names: Mapping[str, Any] | Iterable[str],
    *flags: str,
    default: Any = MISSING,
    help: str | None = None,
    parse: Callable[[str], str] = str.lower,
    meanings: Mapping[str, str] = MappingProxyType({}),
) -> Any:
    """Return a field whose value has a name."""
    values = names if isinstance(names, Mapping) else {name: name for name in names}
    how = {"choices": list(values), "help": help, "type": parse}
    if not flags and default is not MISSING:
        how["nargs"] = "?"
    return argument(default, flags, how, names=values, meanings=meanings)


def arguments_of(kind: Any) -> dict[str, Argument]:
    """Return the arguments of a class by the names of their fields."""
    return {one.name: one.metadata["argument"] for one in fields(kind) if one.metadata}


def typed_words(value: Any) -> list[str]:
    """Return the arguments that would be typed for the fields of a value."""
    given = ((one, getattr(value, one.name)) for one in fields(value) if one.metadata)
    return [one.metadata["argument"].words(held) for one, held in given if held != one.default]


def parsed(kind: type[T], found: Any, **known: Any) -> T:
    """Return the value of a class for parsed arguments; UserError for one that is out of range.

    `known` are values that no argument has, or another than the typed one.
    """
    typed = {
        name: one.value(given)
        for name, one in arguments_of(kind).items()
        if (given := getattr(found, name, None)) is not None
    }
    return kind(**{**typed, **known})


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach:
    """Where a command goes and how its outcome is printed: the options that verbs share."""

    connect: str | None = option(
        "--connect",
        default=None,
        metavar="ENDPOINT",
        help=f"where it listens (default that of `up`, if one runs here, else {DEFAULT_ENDPOINT})",
    )
    run: str | None = option(
        "--run", default=None, metavar="NAME", help="a running `up`, by its name in `sidestep ps`"
    )
    context: str | None = option(
        "--context",
        default=None,
        metavar="NAME",
        help="a system by its name in the settings, see `sidestep config context`",
    )
    id: str | None = option(
        "--id", default=None, metavar="NAME", help="name of the robot (default r1)"
    )
    config: str | None = option("--config", default=None, metavar="FILE", help=CONFIG_HELP)
    json: bool = switch("--json", default=False, help="one JSON object on standard output")
    seize: bool = switch(
        "--seize", default=False, help="take the lease from another operator first"
    )


SHARED: Final = ("connect", "run", "context", "id", "config", "json")
"""The options of `Reach` that every verb of an operator has."""


def add_common(parser: argparse.ArgumentParser, *, listens: bool = False) -> None:
    """Declare `--listen`, or what names a system and its robot; `--config` and `--json`."""
    if listens:
        parser.add_argument("--listen", metavar="ENDPOINT", help=f"(default {DEFAULT_ENDPOINT})")
    add_shared(parser, *(("config", "json") if listens else SHARED))


def add_json(parser: argparse.ArgumentParser) -> None:
    """Declare `--json`."""
    add_shared(parser, "json")


def add_shared(parser: argparse.ArgumentParser, *names: str) -> None:
    """Declare options of `Reach`."""
    arguments = arguments_of(Reach)
    for name in names:
        arguments[name].add_to(parser, name)


ANYWAY: Final = "send {} outside of the known world or in an obstacle, too"


class Facts(NamedTuple):
    """What the decorator says of a command.

    `word` is the verb of JSON output, with its group if it has one. `only_stops`: it needs no
    lease, overtakes what waits, and is allowed in a replay. `begins`: it begins a drive, so it is
    sent in turn. `seizes`: it has the option `--seize`. `short` is its word in lines of the app,
    and `also` are all other words for it there, each with the arguments that it stands for.
    """

    section: str = ""
    rank: int = 0
    example: str = ""
    word: str = ""
    moves: bool = False
    only_stops: bool = False
    begins: bool = False
    seizes: bool = False
    short: str = ""
    also: Mapping[str, tuple[str, ...]] = MappingProxyType({})
    suffixes: tuple[str, ...] = ()


class OperatorCommand:
    """What an operator can do with a robot: `perform(robot)` carries it out.

    The constructor checks the values: UserError names one that is out of range. `effect` is what is
    so when the robot has accepted it.
    """

    __slots__ = ()
    facts: ClassVar[Facts] = Facts()
    effect: ClassVar[str] = ""
    shared: ClassVar[tuple[str, ...]] = SHARED
    """Its options of `Reach`."""
    typed: ClassVar[Any] = None
    """A class with the arguments that `parsed` makes a field of; they stand first."""

    @property
    def verb(self) -> str:
        """The name of the command in JSON output and in the log."""
        return self.facts.word

    @property
    def moves(self) -> bool:
        """True if it can move the robot or change how it moves."""
        return self.facts.moves

    @property
    def is_offline(self) -> bool:
        """True if it reads files instead of the robot: then `run(progress)` carries it out."""
        return False

    @property
    def line(self) -> str:
        """The line that would be typed for it in the app."""
        return " ".join((self.facts.short or self.facts.word, *typed_words(self)))

    @classmethod
    def declare(cls, parser: argparse.ArgumentParser) -> None:
        """Declare its arguments, those without a flag first, and its shared options."""
        if cls.typed is not None:
            for name, one in arguments_of(cls.typed).items():
                one.add_to(parser, name)
        seize = ("seize",) if cls.facts.seizes else ()
        own = sorted(arguments_of(cls).items(), key=lambda named: bool(named[1].flags))
        for after, shared in (("", cls.shared), ("json", seize), ("seize", ())):
            for name, one in own:
                if one.after == after:
                    one.add_to(parser, name)
            add_shared(parser, *shared)

    @classmethod
    def parsed(cls, found: Any) -> "OperatorCommand":
        """Return the command for parsed arguments; UserError for a value out of range."""
        return parsed(cls, found)

    @classmethod
    def summary(cls) -> str:
        """Return the first line of the docstring, as it stands in a table."""
        first = (cls.__doc__ or "").strip().splitlines()[0].removesuffix(".")
        return first[:1].lower() + first[1:]


class FileCommand(OperatorCommand):
    """A command on files, which needs no robot."""

    __slots__ = ()
    shared = ("json",)

    @property
    def is_offline(self) -> bool:
        """True."""
        return True


class Group:
    """Commands of one module with a common first word, such as those of `param`."""

    def __init__(
        self,
        section: str,
        rank: int,
        example: str,
        summary: str,
        suffixes: tuple[str, ...] = (),
    ) -> None:
        self.facts = Facts(section, rank, example, example.split()[0], suffixes=suffixes)
        self._summary = summary
        self.commands: dict[str, type[OperatorCommand]] = {}

    def summary(self) -> str:
        """Return what its commands are for, as it stands in a table."""
        return self._summary

    def declare(self, parser: argparse.ArgumentParser) -> None:
        """Declare the commands below the first word."""
        parsers = add_subcommands(parser, subcommands_in(self))
        for name, kind in self.commands.items():
            kind.declare(parsers[name])

    def parsed(self, found: Any) -> OperatorCommand:
        """Return the command for parsed arguments; UserError for a value out of range."""
        return self.commands[found.action].parsed(found)


def subcommands_in(kind: type[OperatorCommand] | Group) -> Mapping[str, Subcommand]:
    """Return the rows of the commands of a group."""
    below = kind.commands if isinstance(kind, Group) else {}
    return {
        name: Subcommand(one.summary(), one.facts.example, also=one.facts.also)
        for name, one in below.items()
    }


def rows_in(names: Mapping[str, Any]) -> dict[str, Verb]:
    """Return the rows of the verbs that a module defines; `names` are its own, with their values.

    A command without a section is none.
    """
    rows, module = {}, names["__name__"]
    for name, kind in names.items():
        is_here = isinstance(kind, type) and kind.__module__ == module
        if not (isinstance(kind, Group) or (is_here and issubclass(kind, OperatorCommand))):
            continue
        facts: Facts = kind.facts
        if facts.section:
            last = facts.example.split()[facts.section in GROUPS]
            rows[facts.word] = Verb(
                facts.section,
                kind.summary(),
                facts.example,
                module,
                words=name,
                name="" if last == facts.word else last,
                suffixes=facts.suffixes,
                subcommands=subcommands_in(kind),
                rank=facts.rank,
                also=facts.also,
                only_stops=facts.only_stops,
            )
    return rows


def kind_of(verb: Verb) -> type[OperatorCommand] | Group:
    """Import the command of a verb, or the group of its commands."""
    kind: type[OperatorCommand] | Group = getattr(import_module(verb.module), verb.words)
    return kind


def command_in(found: Any) -> Any:
    """Return the command for a verb and its parsed arguments; UserError for an invalid value."""
    return kind_of(VERBS[found.verb]).parsed(found)


@dataclass_transform(
    frozen_default=True,
    kw_only_default=True,
    field_specifiers=(place, option, switch, choice),
)
def command(
    section: str | Group = "",
    rank: int = 0,
    example: str = "",
    *,
    word: str = "",
    short: str = "",
    also: Iterable[str] | Mapping[str, tuple[str, ...]] = (),
    moves: bool = False,
    only_stops: bool = False,
    begins: bool = False,
    seizes: bool | None = None,
    suffixes: tuple[str, ...] = (),
) -> Callable[[type[T]], type[T]]:
    """Make a frozen dataclass of a command; without a section it is no verb.

    The first word of the example that names no group is the verb, unless `word` does. In a `Group`
    commands stand in the order of their definition. One that moves has `--seize`, unless told
    otherwise. `also` are other words for it in the app, which may stand for its arguments, too.
    """
    group = section if isinstance(section, Group) else None
    aliases = dict(also) if isinstance(also, Mapping) else dict.fromkeys(also, ())
    below = section in GROUPS
    words = example.split()

    def make(kind: type[T]) -> type[T]:
        made: Any = dataclass(frozen=True, slots=True, kw_only=True)(kind)
        made.facts = Facts(
            section="" if isinstance(section, Group) else section,
            rank=rank,
            example=example,
            word=word or (" ".join(words[:2]) if group else words[below]),
            moves=moves,
            only_stops=only_stops,
            begins=begins,
            seizes=moves if seizes is None else seizes,
            short=short,
            also=MappingProxyType({short: (), **aliases} if short else aliases),
            suffixes=suffixes,
        )
        if group:
            group.commands[words[1]] = made
        made_class: type[T] = made
        return made_class

    return make


@dataclass(frozen=True, slots=True, kw_only=True)
class TimedCommand(OperatorCommand):
    """A command that is given up after `timeout_s`; None: after the usual attempts."""

    timeout_s: float | None = option(
        "--timeout",
        default=None,
        parse=seconds,
        metavar="S",
        help="give up after this time, in three attempts (default 1.5)",
        after="json",
    )
