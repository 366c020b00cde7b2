"""Texts for people: live lines, colours of states, parts that fit, and wording."""

import json
import os
import pty
from collections.abc import Iterator
from io import StringIO
from math import inf, isfinite, nan, pi, radians
from struct import pack
from typing import TextIO

import pytest
from hypothesis import given
from hypothesis import strategies as st

from checks.harness.messages import make
from ground.text.output import Output, SpokenLines
from ground.text.wording import (
    NONE,
    SONAR_NAMES,
    Part,
    Piece,
    echo,
    fitted,
    heading_deg,
    in_words,
    metres,
    place,
    present_reason,
    side,
    sonar,
    spoken,
    state_role,
    vehicle_role,
)
from protocol.wire.enums import GoalState, Mode, Severity, Vehicle
from protocol.wire.messages import NavigatorStatus, Statustext
from protocol.wire.reasons import Reason
from protocol.wire.statustext import (
    MAX_PIECES,
    PIECE_BYTES,
    StatustextAssembler,
    pieces_of,
)
from robot.core.ring import BEARINGS
from runtime.cli.terminal import DIM
from runtime.clock import ManualClock
from tests.support.each import each
from tests.support.ground.client import CYCLE

LINE = (Part("driving"), Part("3.25 m to go", "3.25 m", age_s=0.2))
MARK = "\0"


class Terminal:
    """The two ends of a terminal of our own."""

    def __init__(self) -> None:
        self._far, near = pty.openpty()
        self.near: TextIO = os.fdopen(near, "w", encoding="utf-8")

    def resize(self, columns: int) -> None:
        import fcntl
        import termios

        fcntl.ioctl(self.near, termios.TIOCSWINSZ, pack("HHHH", 24, columns, 0, 0))

    def seen(self) -> str:
        """Read all output since the last call, up to a mark that is written now.

        One `read` of a terminal may return a part only.
        """
        self.near.write(MARK)
        self.near.flush()
        found = b""
        while not found.endswith(MARK.encode()):
            found += os.read(self._far, 10_000)
        return found.decode().removesuffix(MARK)

    def close(self) -> None:
        self.near.close()
        os.close(self._far)


@pytest.fixture
def terminal(monkeypatch: pytest.MonkeyPatch) -> Iterator[Terminal]:
    monkeypatch.delenv("NO_COLOR", raising=False)
    one = Terminal()
    yield one
    one.close()


def test_elsewhere_each_line_stays_and_is_whole() -> None:
    err = StringIO()
    output = Output(as_json=False, err=err)
    output.line(LINE)
    output.line((Part("reached"),))
    assert err.getvalue() == "driving  3.25 m to go (0.2 s)\nreached\n"


def test_a_terminal_shows_one_line_with_the_old_dimmed(terminal: Terminal) -> None:
    terminal.resize(40)
    output = Output(as_json=False, err=terminal.near)
    output.line(LINE)
    assert terminal.seen() == f"\rdriving  {DIM}3.25 m to go\x1b[0m"
    output.line((Part("reached"),))
    assert terminal.seen() == "\rreached" + " " * 14
    output.note("done")
    assert terminal.seen() == "\r\ndone\r\n"


def test_no_color_is_heeded(terminal: Terminal, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NO_COLOR", "1")
    terminal.resize(40)
    Output(as_json=False, err=terminal.near).line(LINE)
    assert terminal.seen() == "\rdriving  3.25 m to go (0.2 s)"


def test_a_window_that_gets_narrower_is_not_overrun(terminal: Terminal) -> None:
    output = Output(as_json=False, err=terminal.near)
    for columns in (40, 20, 8):
        terminal.resize(columns)
        output.line(LINE)
        shown = terminal.seen().removeprefix("\r").replace(DIM, "").replace("\x1b[0m", "")
        assert len(shown) < columns


def test_json_escapes_what_is_not_printable_and_loses_nothing() -> None:
    out = StringIO()
    found: dict[str, object] = {"text": "\x1b]0;x\x07 \x9b \u202e \U000e0041 \u2028 Grüße"}
    Output(as_json=True, out=out).result(found, "")
    assert out.getvalue().removesuffix("\n").isprintable()
    assert "Grüße" in out.getvalue()
    assert json.loads(out.getvalue()) == found


def test_a_note_can_neither_steer_nor_dim_the_terminal(terminal: Terminal) -> None:
    output = Output(as_json=False, err=terminal.near)
    terminal.resize(40)
    output.note(f"\x1b]0;OWNED\x07{DIM}\r")
    output.line((Part(f"{DIM}\u202ea"),))
    assert terminal.seen() == "?]0;OWNED??[2m?\r\n\r?[2m?a"


def status(
    vehicle: int,
    mode: int = Mode.AUTO,
    goal: int = GoalState.ABORTED,
    reasons: tuple[int, int] = (0, Reason.BUDGET),
) -> NavigatorStatus:
    return make(
        NavigatorStatus, goal_id=7, goal_x_m=1.0, goal_y_m=2.0, goal_distance_m=3.0,
        vehicle=vehicle, mode=mode, goal=goal, vehicle_reason=reasons[0], goal_reason=reasons[1],
    )  # fmt: skip


@each("goal", list(GoalState))
@each("mode", list(Mode))
@each("vehicle", [Vehicle.EMERGENCY_STOP, Vehicle.FAILSAFE])
def test_stopped_robot_is_never_in_the_colour_of_health(
    vehicle: Vehicle, mode: Mode, goal: GoalState
) -> None:
    role = state_role(status(vehicle, mode, goal))
    assert role == {Vehicle.EMERGENCY_STOP: "danger", Vehicle.FAILSAFE: "caution"}[vehicle]
    assert role == vehicle_role(vehicle)


@each(
    ("goal", "role"),
    [
        (GoalState.DRIVING, "ok"),
        (GoalState.AVOIDING, "caution"),
        (GoalState.STUCK, "danger"),
        (GoalState.ABORTED, "danger"),
        (GoalState.REFUSED, "danger"),
    ],
)
def test_goal_gives_the_colour_of_an_armed_robot(goal: GoalState, role: str) -> None:
    assert state_role(status(Vehicle.ACTIVE, goal=goal)) == role
    assert state_role(status(Vehicle.ACTIVE, Mode.MANUAL, goal)) == "ok"


def test_unknown_vehicle_state_is_a_danger() -> None:
    assert vehicle_role(99) == "danger"
    assert vehicle_role(Vehicle.STANDBY) == "text"


def test_reason_of_a_stop_ends_with_the_stop() -> None:
    failed = (Reason.BUDGET, Reason.BUDGET)
    assert present_reason(status(Vehicle.FAILSAFE, reasons=failed)) == Reason.BUDGET
    assert present_reason(status(Vehicle.ACTIVE)) == 0
    assert present_reason(status(Vehicle.STANDBY, reasons=(0, Reason.BY_EMERGENCY_STOP))) == 0
    assert present_reason(status(Vehicle.ACTIVE, reasons=(0, Reason.EMERGENCY_STOPPED))) == 0


@each("mode", [Mode.HOLD, Mode.MANUAL])
def test_reason_of_an_old_goal_is_not_that_of_another_mode(mode: Mode) -> None:
    assert present_reason(status(Vehicle.ACTIVE, mode, reasons=(0, Reason.NO_PROGRESS))) == 0


def test_reason_of_the_goal_is_shown_until_the_next() -> None:
    stuck = status(Vehicle.ACTIVE, goal=GoalState.STUCK, reasons=(0, Reason.NO_PROGRESS))
    assert present_reason(stuck) == Reason.NO_PROGRESS


def piece(text: str, id: int = 0, chunk_seq: int = 0) -> Statustext:
    return Statustext(severity=6, text=text, id=id, chunk_seq=chunk_seq)


def test_a_short_text_is_shown_at_once() -> None:
    assert StatustextAssembler().receive(piece("mode AUTO")) == "mode AUTO"


@each("number", [0, 7])
def test_a_text_is_one_printable_line(number: int) -> None:
    """Escape line breaks, which would let a robot imitate other lines."""
    text = StatustextAssembler().receive(piece("a\nr2: b\x1b]0;c\x07\u202e", number))
    assert text == "a?r2: b?]0;c??"


def test_pieces_are_put_together() -> None:
    texts = StatustextAssembler()
    assert texts.receive(piece("a" * 50, 7, 0)) == ""
    assert texts.receive(piece("b" * 50, 7, 1)) == ""
    assert texts.receive(piece("end", 7, 2)) == "a" * 50 + "b" * 50 + "end"


def test_text_without_its_first_piece_is_shown() -> None:
    texts = StatustextAssembler()
    assert texts.receive(piece("end", 7, 2)) == "end"
    texts.receive(piece("a" * 50, 8, 0))
    assert texts.receive(piece("other", 9, 0)) == "other"


def test_pieces_without_end_are_shown_before_memory_runs_out() -> None:
    texts = StatustextAssembler()
    shown = [texts.receive(piece("x" * 50, 1, seq)) for seq in range(20)]
    assert len(shown[-1]) == 1000


def test_anything_else_is_no_text() -> None:
    assert StatustextAssembler().receive(CYCLE) == ""


@each("text", ["x", "Größe", "a" * 50, "b" * 51, "c" * 150, "d" * 999])
def test_what_is_taken_to_pieces_comes_together_again(text: str) -> None:
    texts = StatustextAssembler()
    *before, last = [texts.receive(piece) for piece in pieces_of(text, 7, Severity.NOTICE)]
    assert not any(before)
    assert last == text


def test_a_text_too_long_for_all_pieces_is_cut_and_still_ends() -> None:
    texts = StatustextAssembler()
    *before, last = [texts.receive(piece) for piece in pieces_of("x" * 100_000, 7, Severity.ERROR)]
    assert not any(before)
    assert last == "x" * (MAX_PIECES * PIECE_BYTES - 1)


PARTS = (
    Part("driving"),
    Part("3.25 m to go", "3.25 m"),
    Part(""),
    Part("echo 0.50 m", "echo 0.50"),
)


def plain(width: int) -> str:
    return words_of(fitted(PARTS, width, dims=True))


def words_of(pieces: list[Piece]) -> str:
    return "".join(piece.text for piece in pieces)


def test_wide_line_shows_everything() -> None:
    assert plain(80) == "driving  3.25 m to go  echo 0.50 m" == in_words(PARTS)


def test_narrow_line_uses_short_forms() -> None:
    assert plain(33) == "driving 3.25 m echo 0.50"
    assert plain(24) == "driving 3.25 m echo 0.50"


def test_with_little_room_the_last_parts_go_and_then_it_is_cut() -> None:
    assert plain(23) == "driving 3.25 m"
    assert plain(13) == "driving"
    assert plain(3) == "dri"


def test_an_old_part_is_dimmed_and_takes_no_more_room() -> None:
    pieces = fitted((Part("a"), Part("bc", age_s=0.25)), 80, dims=True)
    assert pieces == [Piece("a"), Piece("  "), Piece("bc", dim=True)]


def test_without_dimming_the_age_is_shown() -> None:
    old = (Part("a"), Part("bc", age_s=0.25))
    assert in_words(old) == "a  bc (0.2 s)"
    assert words_of(fitted(old, 80, dims=False)) == "a  bc (0.2 s)"


def test_a_short_form_that_cannot_be_dimmed_has_its_age_too() -> None:
    old = (Part("a"), Part("long words", "bc", age_s=0.25))
    assert words_of(fitted(old, 12, dims=False)) == "a bc (0.2 s)"
    assert words_of(fitted(old, 11, dims=False)) == "a"


@given(
    st.lists(
        st.builds(
            Part,
            st.text("abc", max_size=9),
            st.text("abc", max_size=5),
            st.none() | st.floats(0.0, 9.0),
        ),
        max_size=6,
    ),
    st.integers(1, 60),
    st.booleans(),
)
def test_no_line_is_wider_than_its_terminal(parts: list[Part], width: int, dims: bool) -> None:
    assert len(words_of(fitted(parts, width, dims=dims))) <= width


@each(
    ("angle_deg", "words"),
    [
        (0.0, "straight ahead"),
        (0.4, "straight ahead"),
        (34.2, "34° left"),
        (-34.2, "34° right"),
        (120.0, "120° left, behind"),
        (-120.0, "120° right, behind"),
        (180.0, "straight behind"),
        (-179.8, "straight behind"),
        (350.0, "10° right"),
        (-725.0, "5° right"),
        (nan, NONE),
        (inf, NONE),
    ],
)
def test_a_direction_has_a_side_and_whole_degrees(angle_deg: float, words: str) -> None:
    assert side(radians(angle_deg)) == words


@given(st.floats())
def test_any_number_is_a_direction_or_none(angle_rad: float) -> None:
    angle_deg = heading_deg(angle_rad)
    assert (angle_deg is None) == (not isfinite(angle_rad))
    assert angle_deg is None or -180.0 <= angle_deg <= 180.0
    assert side(angle_rad)


def test_each_sonar_is_called_by_where_it_looks() -> None:
    assert [sonar(bearing_rad) for bearing_rad in BEARINGS] == list(SONAR_NAMES)
    for name, bearing_rad in zip(SONAR_NAMES, BEARINGS, strict=True):
        assert side(bearing_rad).startswith(f"{name[1:]}°")
        assert (name[0] == "L") == (bearing_rad > 0.0)


@each("bearing_rad", [0.0, 0.1, pi / 2, -pi, 1e300, nan, inf])
def test_where_no_sonar_looks_there_is_no_name(bearing_rad: float) -> None:
    assert sonar(bearing_rad) == ""


@given(st.floats(), st.floats())
def test_places_and_distances_are_short_whatever_they_are(x_m: float, y_m: float) -> None:
    assert len(metres(x_m)) < 20
    assert len(place(x_m, y_m)) < 40
    assert echo(x_m, y_m)


def test_echo_is_described_by_its_known_values() -> None:
    assert echo(0.213, BEARINGS[5]) == "echo 0.21 m 34° left (L34)"
    assert echo(0.213, 0.5) == "echo 0.21 m 29° left"
    assert echo(0.213, nan) == "echo 0.21 m"
    assert echo(inf, nan) == "no echo"
    assert echo(nan, nan) == NONE
    assert echo(nan, 0.5) == "echo -- 29° left"


def test_plain_line_is_read_aloud_with_units_in_words() -> None:
    line = "avoiding  3.09 m to go  0.16 m/s  echo 0.18 m  6 s"
    words = "avoiding, 3.09 metres to go, 0.16 metres per second, echo 0.18 metres, 6 seconds"
    assert spoken(line) == words
    assert spoken("driving  -- to go") == "driving, unknown to go"


def test_plain_lines_come_at_each_change_else_every_ten_seconds() -> None:
    clock, err = ManualClock(0), StringIO()
    lines = SpokenLines(Output(as_json=False, err=err), clock)
    for second in range(25):
        state = "avoiding" if second >= 13 else "driving"
        lines.show([Part(f"{state:<8}"), Part(f"{25 - second} m to go")])
        clock.advance(1_000_000_000)
    said = ["driving, 25", "driving, 15", "avoiding, 12", "avoiding, 2"]
    assert err.getvalue().splitlines() == [f"{one} metres to go" for one in said]
