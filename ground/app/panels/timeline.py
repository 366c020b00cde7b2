"""The timeline of a recording: where it is, how fast, and its marks."""

from collections.abc import Sequence

from ground.app.playback.player import Player
from ground.app.widgets.rows import Row, Span, cut, faint, head, row
from ground.recording.bookmarks import Mark


def timeline_rows(player: Player, width: int) -> list[Row]:
    """A line with its marks, and what the last of them says."""
    where = f"{player.position_s:7.2f} / {player.duration_s:.2f} s "
    state = "▶  " if player.playing else "|| "
    line = line_spans(player, max(4, width - len(where) - 12))
    passed = [mark for mark in player.bus.marks if mark.time_s <= player.position_s]
    said = f" {passed[-1].time_s:.1f} s {passed[-1].kind}: {passed[-1].text}" if passed else ""
    return [
        cut(row(Span(f" {state}{player.speed:g}x ", "accent"), where, *line), width),
        cut(row(head(" mark"), Span(said or " none yet", "text" if said else "faint")), width),
    ]


def line_spans(player: Player, cells: int) -> list[Span]:
    """Gone by, here, still to come; a mark is a stroke through it."""
    share = player.position_s / player.duration_s if player.duration_s else 1.0
    here = min(cells - 1, int(share * cells))
    strokes = marked(player.bus.marks, player.duration_s, cells)
    text = "".join("┃" if at in strokes else ("━" if at < here else "─") for at in range(cells))
    return [Span(text[:here], "accent"), Span("●", "accent"), faint(text[here + 1 :])]


def marked(marks: Sequence[Mark], duration_s: float, cells: int) -> set[int]:
    if duration_s <= 0.0:
        return set()
    return {min(cells - 1, int(mark.time_s / duration_s * cells)) for mark in marks}
