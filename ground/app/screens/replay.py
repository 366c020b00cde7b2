"""Show the Replay screen: the Drive screen over a recording, with its timeline."""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Final

from textual.app import ComposeResult

from ground.app.app_interface import AppControl
from ground.app.chrome.key_bar import NextKey, keys_when
from ground.app.input.keymap import Layer, Situation
from ground.app.playback.player import Player
from ground.app.playback.read_only_app import ReadOnlyApp
from ground.app.screens.app_screen import Action
from ground.app.screens.drive import DriveScreen
from ground.app.widgets.lines import Lines
from ground.app.widgets.rows import Row, Span, cut, faint, head, row
from ground.recording.catalogue import UNFINISHED, newest_first, recordings_in
from ground.recording.summary import Bookmark, Summary, summary_of
from ground.user.folders import recordings_folder
from protocol.outcome import WIDEST
from runtime.errors import UserError

FAR_S: Final = 10.0
NO_RECORDING: Final = " no recording is open: press o to choose one, or type: replay FILE"
MAX_LISTED: Final = 18


class ReplayScreen(DriveScreen):
    """The Drive screen over a recording."""

    key_layer = Layer.REPLAY

    def __init__(self, app: AppControl) -> None:
        super().__init__(ReadOnlyApp(app))
        self._app_below = app

    def compose_content(self) -> ComposeResult:
        """Compose the Drive screen and the timeline."""
        yield from super().compose_content()
        yield Lines(id="timeline")

    @property
    def player(self) -> Player | None:
        """The player, if a recording is open."""
        return self._app_below.player

    def draw(self) -> None:
        """Draw the Drive screen and the timeline."""
        super().draw()
        panel = self.lines("timeline")
        if reading := self._app_below.reader.words:
            panel.show([row(Span(f" {reading}", "accent"))])
        elif self.player is None:
            panel.show([row(faint(NO_RECORDING))])
        else:
            panel.show(timeline_rows(self.player, panel.size.width))

    def key_layers(self) -> tuple[Layer, ...]:
        """Return the layers of the map, without those that command a robot."""
        if self.typing:
            return super().key_layers()
        cursor = () if self.map_cursor.cursor is None else (Layer.CURSOR,)
        return (Layer.STOP, *cursor, Layer.DRIVE, Layer.REPLAY, Layer.STATION)

    def following_keys(self) -> tuple[NextKey, ...]:
        """Return those of the cursor while it is in use, else those that play."""
        is_free = self.map_cursor.cursor is None
        return keys_when(Situation.REPLAY if is_free else Situation.CURSOR)

    def actions(self) -> Mapping[str, Action]:
        """Return the actions that are possible now, by id."""
        found: dict[str, Action] = {**super().actions(), "replay-open": self.choose_recording}
        player = self.player
        if player is None:
            return found
        return {
            **found,
            "replay-back": partial(player.step, -1),
            "replay-on": partial(player.step, 1),
            "replay-play": player.play_or_pause,
            "replay-slower": partial(player.faster, 0.5),
            "replay-faster": partial(player.faster, 2.0),
            "replay-mark": self.to_mark,
            "replay-jump-back": partial(player.jump, -FAR_S),
            "replay-jump-on": partial(player.jump, FAR_S),
            "replay-begin": partial(player.seek, 0.0),
            "replay-end": partial(player.seek, player.duration_s),
        }

    def to_mark(self) -> None:
        """Move to the next mark and log its text."""
        if self.player is not None:
            self.interface.note(self.player.to_mark())

    def choose_recording(self) -> None:
        """Let the operator choose a recording of the user's folder or of this one."""
        self.interface.run_in_background(newest_recordings, self._choose)

    def _choose(self, found: Sequence[Summary]) -> None:
        lines = {in_one_line(one): one.path for one in found}
        if lines:
            self.interface.choose("recording", list(lines), lambda line: self.open(lines[line]))
        else:
            self.interface.note(f"no recording in {recordings_folder()} or here: replay FILE")

    def open(self, path: Path) -> None:
        """Open a recording; an error goes to the log."""
        try:
            self._app_below.open_replay(path)
        except UserError as error:
            self.interface.note(str(error))


def newest_recordings() -> list[Summary]:
    """Return the newest recordings of the user, of this folder and of those below it.

    Those that are still being recorded are the last, so that the first choice is a finished one.
    """
    found = [*recordings_in(recordings_folder()), *recordings_in(Path(), below=True)]
    once = {path.resolve(): path for path in reversed(found)}
    summaries = [summary_of(path) for path in newest_first(once.values())[:MAX_LISTED]]
    return sorted(summaries, key=lambda one: one.is_running)


def in_one_line(one: Summary) -> str:
    """Return time, world, outcome and length of a recording, and its file."""
    length = "--" if one.length_s is None else f"{one.length_s:.0f} s"
    facts = f"{one.world or '--':<12} {one.outcome or '--':<{WIDEST}} {length:>6}"
    running = f"  {UNFINISHED}" if one.is_running else ""
    return f"{one.began.astimezone():%m-%d %H:%M:%S %Z}  {facts}  {one.path.name}{running}"


def timeline_rows(player: Player, width: int) -> list[Row]:
    """Return the timeline with its marks, and the text of the last mark."""
    where = f"{player.position_s:7.2f} / {player.duration_s:.2f} s "
    state = "▶  " if player.playing else "|| "
    line = line_spans(player, max(4, width - len(where) - 12))
    passed = [mark for mark in player.bus.marks if mark.time_s <= player.position_s]
    text = f" {passed[-1].time_s:.1f} s {passed[-1].kind}: {passed[-1].text}" if passed else ""
    return [
        cut(row(Span(f" {state}{player.speed:g}x ", "accent"), where, *line), width),
        cut(row(head(" mark"), Span(text or " none yet", "text" if text else "faint")), width),
    ]


def line_spans(player: Player, cells: int) -> list[Span]:
    """Return the timeline: the part played, the position, the rest; marks are strokes."""
    share = player.position_s / player.duration_s if player.duration_s else 1.0
    here = min(cells - 1, int(share * cells))
    strokes = marked(player.bus.marks, player.duration_s, cells)
    text = "".join("┃" if at in strokes else ("━" if at < here else "─") for at in range(cells))
    return [Span(text[:here], "accent"), Span("●", "accent"), faint(text[here + 1 :])]


def marked(marks: Sequence[Bookmark], duration_s: float, cells: int) -> set[int]:
    """Return the cells of the timeline that have a mark."""
    if duration_s <= 0.0:
        return set()
    return {min(cells - 1, int(mark.time_s / duration_s * cells)) for mark in marks}
