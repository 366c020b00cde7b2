"""Define the command line: it completes words, and takes pasted text as plain text."""

from collections.abc import Callable, Sequence
from typing import Final, TypeAlias

from textual.suggester import Suggester
from textual.widgets import Input

from ground.app.widgets.rows import Row, Span, cut, faint, row
from ground.console.completion import Assistance, Candidate

Assist: TypeAlias = Callable[[str], Assistance]
MAX_ROWS: Final = 8
LEAST_WORD: Final = 12
MOST_WORD: Final = 40


def no_assistance(_: str) -> Assistance:
    """Return nothing, for lines that are no commands."""
    return Assistance()


class GhostText(Suggester):
    """Suggests the first completion, else the missing arguments, faintly behind the cursor."""

    def __init__(self, line: "CommandLine") -> None:
        super().__init__(use_cache=False, case_sensitive=True)
        self._line = line

    async def get_suggestion(self, value: str) -> str | None:
        """Return the text with what may follow it."""
        found = self._line.assistance(value)
        first = found.candidates[0].line if found.candidates else ""
        if first.startswith(value) and first != value:
            return first
        return f"{value}{'' if value.endswith(' ') else ' '}{found.hint}" if found.hint else None


class TypedLine(Input):
    """A line of input; `submit` is called at Enter, so before the next key is handled."""

    def __init__(
        self, submit: Callable[[str], None], *, id: str, suggester: Suggester | None = None
    ) -> None:
        super().__init__(id=id, select_on_focus=False, compact=True, suggester=suggester)
        self._submit = submit

    async def action_submit(self) -> None:
        """Pass on the line."""
        self._submit(self.value)


class CommandLine(TypedLine):
    """A line of input with completions."""

    def __init__(self, assist: Assist, submit: Callable[[str], None]) -> None:
        super().__init__(submit, id="command", suggester=GhostText(self))
        self._assist = assist
        self._known: tuple[str, Assistance] | None = None
        self._offered: Sequence[Candidate] = ()
        self._typed = ""

    def begin(self, text: str, assist: Assist | None = None) -> None:
        """Start with this text, the cursor behind it, and take the focus."""
        if assist is not None:
            self._assist, self._known, self._offered = assist, None, ()
        self.placeholder = self.assistance("").hint
        self.value = text
        self.cursor_position = len(text)
        self.screen.set_focus(self)

    def assistance(self, text: str) -> Assistance:
        """Return what helps to continue a text."""
        if self._known is None or self._known[0] != text:
            self._known = text, self._assist(text)
        return self._known[1]

    @property
    def chosen(self) -> int | None:
        """The index of the completion that was inserted; None when none was."""
        lines = [one.line for one in self._offered]
        return lines.index(self.value) if self.value in lines else None

    @property
    def candidates(self) -> Sequence[Candidate]:
        """The completions to choose from."""
        if self.chosen is not None:
            return self._offered
        return self.assistance(self.value).candidates

    def complete(self, step: int = 1) -> None:
        """Insert the next (1) or previous (-1) completion; further calls go through all."""
        at = self.chosen
        if at is None:
            self._offered, self._typed = self.assistance(self.value).candidates, self.value
            at = -1 if step > 0 else 0
        if self._offered:
            self.value = self._offered[(at + step) % len(self._offered)].line
        self.cursor_position = len(self.value)

    def drop_choice(self) -> bool:
        """Return to the text that was typed; return False when no completion was inserted."""
        if self.chosen is None:
            return False
        self._offered = ()
        self.begin(self._typed)
        return True

    def action_cursor_right(self, select: bool = False) -> None:
        """Move the cursor right; at the end, accept a completion but no hint."""
        if not self.cursor_at_end or select:
            super().action_cursor_right(select)
            return
        first = next(iter(self.candidates), None)
        if first is not None and first.line.startswith(self.value):
            self.value = first.line
            self.cursor_position = len(self.value)


def insert(line: Input, text: str) -> None:
    """Insert one line of text without control characters, in place of the selection."""
    line.replace(printable(text), *line.selection)


def printable(text: str) -> str:
    """Return the first line that is not blank, at most 400 characters, all printable."""
    lines = (line.strip() for line in text.splitlines())
    line = next((line for line in lines if line), "")
    return "".join(mark for mark in line if mark.isprintable())[:400]


def candidate_rows(
    candidates: Sequence[Candidate], chosen: int | None, width: int, height: int
) -> list[Row]:
    """Return the completions with their meaning, the chosen one in sight.

    With more than fit, the last row says how many there are.
    """
    room = max(0, min(MAX_ROWS, height))
    if len(candidates) <= room:
        first, shown = 0, candidates
    else:
        room = max(0, room - 1)
        first = max(0, min((chosen or 0) - room // 2, len(candidates) - room))
        shown = candidates[first : first + room]
    longest = max([LEAST_WORD, *(len(one.word) for one in shown)])
    wide = min(MOST_WORD, longest) if any(one.description for one in shown) else longest
    rows = [
        row(
            Span(f" {one.word:<{wide}} ", "reverse" if at == chosen else "text"),
            faint(f" {one.description}"),
        )
        for at, one in enumerate(shown, start=first)
    ]
    if len(shown) < len(candidates) and height > 0:
        rows.append(row(faint(f" {len(candidates)} in all: type to narrow, Tab chooses")))
    return [cut(one, width) for one in rows]
