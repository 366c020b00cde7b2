"""What persons do with their programs, and what the programs say."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

from checks.simulation.events import Argument
from checks.simulation.hosts.scheduler import Scheduler


@dataclass(slots=True, eq=False)
class Deed:
    """What a person asks of a program, until the program says its end.

    `cancelled_ns` is when the person, or a time limit, has ended it early.
    """

    program: str
    verb: str
    arguments: tuple[Argument, ...]
    began_ns: int
    ended_ns: int | None = None
    cancelled_ns: int | None = None
    killed: bool = False

    def __str__(self) -> str:
        return " ".join(map(str, (self.verb, *self.arguments)))

    def until_ns(self, now_ns: int) -> int:
        """Return the time of its end, or now."""
        return now_ns if self.ended_ns is None else self.ended_ns


@dataclass(frozen=True, slots=True)
class Ended:
    """The end of a command or of `up`: exit code, the outcome or None, and the error in words."""

    code: int
    outcome: Any = None
    error: str = ""


@dataclass(frozen=True, slots=True)
class Shown:
    """A text that a program shows; `where` names the part of it."""

    where: str
    text: str


class Said(NamedTuple):
    """A word of a program: a value of the product, or text in which a value is rendered."""

    ns: int
    program: str
    value: Any
    deed: Deed | None = None


@dataclass(slots=True)
class Journal:
    """All deeds and all words of a run."""

    scheduler: Scheduler
    deeds: list[Deed] = field(default_factory=list)
    words: list[Said] = field(default_factory=list)

    def begin(self, program: str, verb: str, arguments: tuple[Argument, ...]) -> Deed:
        """Note the begin of a deed."""
        deed = Deed(program, verb, arguments, self.scheduler.now_ns)
        self.deeds.append(deed)
        return deed

    def end(self, deed: Deed, value: Any) -> None:
        """Note the end of a deed, and what was said at its end."""
        deed.ended_ns = self.scheduler.now_ns
        self.say(deed.program, value, deed)

    def cancel(self, deed: Deed) -> None:
        """Note that a deed is ended early."""
        if deed.cancelled_ns is None:
            deed.cancelled_ns = self.scheduler.now_ns

    def killed(self, program: str) -> None:
        """Note that a program has been killed."""
        for deed in self.deeds:
            if deed.program == program and deed.ended_ns is None:
                deed.ended_ns, deed.killed = self.scheduler.now_ns, True

    def say(self, program: str, value: Any, deed: Deed | None = None) -> None:
        """Note a word; the same text again is no news."""
        self.words.append(Said(self.scheduler.now_ns, program, value, deed))
