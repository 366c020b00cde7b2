"""Put directions and distances in words, and join the pieces of a long STATUSTEXT message.

A value that is not finite is shown as missing.
"""

from math import degrees, inf, isfinite, pi, remainder
from typing import Final

from protocol.ring import BEARINGS_RAD, CONE_RAD, SONARS
from protocol.wire.message import Message
from protocol.wire.messages import Statustext
from protocol.wire.statustext import MAX_PIECES, PIECE_BYTES
from runtime.cli.terminal import printable
from runtime.units import NS_PER_S

SONAR_NAMES: Final = tuple(f"{'LR'[b < 0.0]}{abs(degrees(b)):.0f}" for b in BEARINGS_RAD)
"""Names of the sonars from right to left: side and degrees from the heading."""

NEAR_STEPS: Final = 0.01
NONE: Final = "--"
FAR_M: Final = 1e5


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


class StatustextAssembler:
    """Joins one sender's texts, each to one printable line.

    A piece without a text begun before it is shown alone.
    """

    def __init__(self) -> None:
        self._id = 0
        self._pieces: list[str] = []

    def receive(self, message: Message) -> str:
        """Return the text that this message completes, or nothing."""
        if not isinstance(message, Statustext):
            return ""
        if not message.id:
            return printable(message.text)
        if message.id != self._id or message.chunk_seq != len(self._pieces):
            self._id, self._pieces = message.id, []
        self._pieces.append(message.text)
        if len(message.text.encode()) >= PIECE_BYTES and len(self._pieces) < MAX_PIECES:
            return ""
        text, self._pieces, self._id = "".join(self._pieces), [], 0
        return printable(text)


def aged(text: str, age_ns: int) -> str:
    """Append the age to a text that arrived late."""
    if age_ns <= LIVE_NS:
        return text
    age_s = age_ns // NS_PER_S
    if age_s < 120:
        return f"{text} ({age_s} s ago)"
    return f"{text} ({age_s // 60} min ago)" if age_s < 7200 else f"{text} ({age_s // 3600} h ago)"
