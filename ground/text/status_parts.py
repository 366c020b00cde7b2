"""Make a status line of parts, shortened to the width of the terminal; old values are marked.

The colour of a state and its reason are decided here for the side panel, the status line, the
roster and the stop band.
"""

from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

from protocol.wire.enums import GoalState, Mode, Vehicle
from protocol.wire.messages import NavigatorStatus
from protocol.wire.reasons import Reason


class Part(NamedTuple):
    """One part of the line.

    `short` is used where room is scarce; `age_s` is set once the value is not live any more.
    """

    text: str
    short: str = ""
    age_s: float | None = None

    @property
    def words(self) -> str:
        """The text, with its age in brackets if it has one, for output that cannot be dimmed."""
        return self.dated(self.text)

    def dated(self, text: str) -> str:
        """Append the age to a text, if there is one."""
        return text if self.age_s is None else f"{text} ({self.age_s:.1f} s)"


def in_words(parts: Iterable[Part]) -> str:
    """Return the whole line, without a limit of its length."""
    return "  ".join(part.words for part in parts if part.text)


class Piece(NamedTuple):
    """Some text of a line; `dim` if its value is not live any more."""

    text: str
    dim: bool = False


def fitted(parts: Sequence[Part], width: int, *, dims: bool) -> list[Piece]:
    """Return pieces of at most `width` characters; with `dims` old ones are dimmed, not dated.

    Parts come in order of importance: if even their short forms do not fit, the last ones are left
    out.
    """
    shown = [part for part in parts if part.text]
    texts = [part.text if dims else part.words for part in shown]
    gap = "  "
    if length_of(texts, gap) > width:
        short = [part.short or part.text for part in shown]
        texts, gap = short, " "
        if not dims:
            texts = [part.dated(text) for part, text in zip(shown, short, strict=True)]
    while len(texts) > 1 and length_of(texts, gap) > width:
        texts.pop()
    texts = [text[:width] for text in texts]
    ages = [part.age_s for part in shown]
    pieces: list[Piece] = []
    for text, age_s in zip(texts, ages, strict=False):
        pieces += [Piece(gap)] if pieces else []
        pieces.append(Piece(text, dim=dims and age_s is not None))
    return pieces


def length_of(texts: Sequence[str], gap: str) -> int:
    """Return the length of the joined texts."""
    return sum(map(len, texts)) + len(gap) * max(0, len(texts) - 1)


OK: Final = "ok"
CAUTION: Final = "caution"
DANGER: Final = "danger"
NEUTRAL: Final = "text"
FAILED_GOALS: Final = (GoalState.STUCK, GoalState.ABORTED, GoalState.REFUSED)
GOAL_MODES: Final = (Mode.AUTO, Mode.GUIDED, Mode.SMART_RTL)
VEHICLE_ROLES: Final = {
    Vehicle.EMERGENCY_STOP: DANGER,
    Vehicle.FAILSAFE: CAUTION,
    Vehicle.ACTIVE: OK,
    Vehicle.STANDBY: NEUTRAL,
    Vehicle.BOOT: NEUTRAL,
}
STOPS: Final = frozenset(
    {
        Reason.BY_EMERGENCY_STOP,
        Reason.EMERGENCY_STOPPED,  # in recordings of version 0.1
        Reason.DISARMED,
        *(reason for reason in Reason if Reason.TICKS_LOST <= reason < Reason.BLOCKED),
    }
)
"""Reasons of a goal's end that were the vehicle's: the emergency stop, disarming, a failsafe."""


def vehicle_role(vehicle: int) -> str:
    """Return the role of the colour of a vehicle state; an unknown state is a danger."""
    return next((role for known, role in VEHICLE_ROLES.items() if known == vehicle), DANGER)


def driving(status: NavigatorStatus) -> bool:
    """Return whether a goal is being pursued."""
    return GoalState.ACCEPTED <= status.goal <= GoalState.ALIGNING


def state_role(status: NavigatorStatus) -> str:
    """Return the role of the colour of a robot's state.

    The goal counts only while the vehicle is armed and its mode drives to goals.
    """
    if status.vehicle != Vehicle.ACTIVE or status.mode not in GOAL_MODES:
        return vehicle_role(status.vehicle)
    if status.goal in FAILED_GOALS:
        return DANGER
    return CAUTION if status.goal == GoalState.AVOIDING else OK


def present_reason(status: NavigatorStatus) -> int:
    """Return the reason of the present state, or 0.

    The reason of an ended goal belongs to the past once the vehicle is armed again after the stop,
    or once the mode has changed.
    """
    if status.vehicle != Vehicle.ACTIVE or status.mode not in GOAL_MODES:
        return status.vehicle_reason
    return Reason.NONE if status.goal_reason in STOPS else status.goal_reason
