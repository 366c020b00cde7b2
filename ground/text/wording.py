"""Put directions and distances in words; a value that is not finite is shown as missing.

Make a status line of parts, shortened to the width of the terminal; old values are marked.

The colour of a state and its reason are decided here for the side panel, the status line, the
roster and the stop band.
"""

import re
from collections.abc import Iterable, Sequence
from math import degrees, inf, isfinite, pi, remainder
from typing import Final, NamedTuple

from protocol.ring import BEARINGS_RAD, CONE_RAD, SONARS
from protocol.wire.enums import GoalState, Mode, Vehicle
from protocol.wire.messages import NavigatorStatus
from protocol.wire.reasons import Reason
from runtime.units import NS_PER_S

SONAR_NAMES: Final = tuple(f"{'LR'[b < 0.0]}{abs(degrees(b)):.0f}" for b in BEARINGS_RAD)
"""Names of the sonars from right to left: side and degrees from the heading."""

NEAR_STEPS: Final = 0.01
NONE: Final = "--"
FAR_M: Final = 1e5
MOST_NAMES: Final = 6


def heading_deg(angle_rad: float) -> float | None:
    """Return a direction within -180 to 180 degrees; None if it is not finite."""
    return degrees(remainder(angle_rad, 2.0 * pi)) if isfinite(angle_rad) else None


def side(angle_rad: float) -> str:
    """Return the side and the angle in degrees, as in `34° left`."""
    angle_deg = heading_deg(angle_rad)
    if angle_deg is None:
        return NONE
    whole = round(abs(angle_deg))
    if whole == 0:
        return "straight ahead"
    if whole == 180:
        return "straight behind"
    behind = ", behind" if whole > 90 else ""
    return f"{whole}° {left_or_right(angle_deg)}{behind}"


def left_or_right(angle: float) -> str:
    """Return the side of a non-zero angle: positive is left."""
    return "left" if angle > 0.0 else "right"


def sonar(bearing_rad: float) -> str:
    """Return the name of the sonar at a bearing, empty if there is none."""
    if not isfinite(bearing_rad):
        return ""
    place = bearing_rad / CONE_RAD + (SONARS - 1) / 2.0
    if not -0.5 < place < SONARS - 0.5 or abs(place - round(place)) > NEAR_STEPS:
        return ""
    return SONAR_NAMES[round(place)]


def metres(value_m: float) -> str:
    """Format a distance with its unit."""
    if not isfinite(value_m):
        return NONE
    return f"{value_m:z.2f} m" if abs(value_m) < FAR_M else f"{value_m:z.3g} m"


def short(value: float) -> str:
    """Format a number with two figures."""
    if not 10.0 <= abs(value) < FAR_M:
        return f"{value:z.2g}"
    return f"{value:z.0f}"


def few(names: Sequence[str]) -> str:
    """Return the first names, and the number of the others."""
    named = " ".join(names[:MOST_NAMES])
    return named if len(names) <= MOST_NAMES else f"{named} and {len(names) - MOST_NAMES} more"


def place(x_m: float, y_m: float) -> str:
    """Format a position in metres."""
    if not (isfinite(x_m) and isfinite(y_m)):
        return NONE
    return f"({metres(x_m).removesuffix(' m')}, {metres(y_m).removesuffix(' m')})"


def echo(range_m: float, bearing_rad: float) -> str:
    """Describe range and direction of the nearest echo."""
    if range_m == inf:
        return "no echo"
    away = f"echo {metres(range_m)}"
    if not isfinite(bearing_rad):
        return away if isfinite(range_m) else NONE
    name = sonar(bearing_rad)
    return f"{away} {side(bearing_rad)}" + (f" ({name})" if name else "")


LIVE_NS = 2 * NS_PER_S
"""Age up to which a text is shown without its age."""


def aged(text: str, age_ns: int) -> str:
    """Append the age to a text that arrived late."""
    if age_ns <= LIVE_NS:
        return text
    age_s = age_ns // NS_PER_S
    if age_s < 120:
        return f"{text} ({age_s} s ago)"
    return f"{text} ({age_s // 60} min ago)" if age_s < 7200 else f"{text} ({age_s // 3600} h ago)"


THEMES: Final = ("dark", "light", "contrast", "ansi", "mono")


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


NUMBER: Final = re.compile(r"-?\d+(?:\.\d+)?")
SPOKEN: Final = (
    (re.compile(r"(?<=\d) m/s\b"), " metres per second"),
    (re.compile(r"(?<=\d) m\b"), " metres"),
    (re.compile(r"(?<=\d) s\b"), " seconds"),
    (re.compile(r"(?<=\d) us\b"), " microseconds"),
    (re.compile(r"(?<=\d) deg\b"), " degrees"),
    (re.compile(r"--"), "unknown"),
    (re.compile(r"  +"), ", "),
)
"""How a screen reader should pronounce units; a comma is a pause."""


def spoken(text: str) -> str:
    """Return a status line as it is read aloud."""
    for pattern, words in SPOKEN:
        text = pattern.sub(words, text)
    return text
