"""Functions for scripts on pymavlink: the newest messages, requests with retries, and transfers."""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from pymavlink import mavutil

from tests.interop.clients.steps import (
    EMERGENCY,
    PATIENCE_S,
    Place,
    StepError,
    pause,
    repeat,
    until,
)

mavlink: Final = mavutil.mavlink
GROUND_STATION: Final = (255, 190)
DEG_E7: Final = 1e7
LOG_CHUNK: Final = 90
MAX_READ: Final = 50
SHOWN: Final = 12
SILENCE_S: Final = 1.0
"""A request without an answer is repeated after this time."""
GLOBAL: Final = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT


class Station:
    """Messages received from the vehicle, and transfers; `mav` sends.

    A subclass receives in `look` and gives the messages to `take`. `lost` counts missing frames.
    """

    mav: Any
    lost: int = 0

    def __init__(self) -> None:
        self.newest: dict[str, Any] = {}
        self.counts: Counter[str] = Counter()
        self.texts: list[str] = []
        self.handlers: dict[str, Callable[[Any], None]] = {}
        self.newest_state: Any = None

    def look(self) -> None:
        """Receive for a moment."""
        pause()

    def until(
        self, condition: Callable[[], object], what: str, within_s: float = PATIENCE_S
    ) -> None:
        """Receive until a condition holds."""
        try:
            until(condition, what, within_s, self.look)
        except StepError as error:
            raise StepError(f"{error}; {self.seen()}") from None

    def repeat(
        self,
        act: Callable[[], object],
        condition: Callable[[], object],
        what: str,
        within_s: float = PATIENCE_S,
    ) -> int:
        """Act until a condition holds."""
        try:
            return repeat(
                act, condition, what, every_s=SILENCE_S, within_s=within_s, look=self.look
            )
        except StepError as error:
            raise StepError(f"{error}; {self.seen()}") from None

    def seen(self) -> str:
        """Return the vehicle's last reported state, for the message of a failure."""
        acknowledged = self.newest.get("COMMAND_ACK")
        last = "" if acknowledged is None else f", {acknowledged}"
        state = "no heartbeat" if self.newest_state is None else f"{self.newest_state}"
        # One that is repeated would hide the reason.
        texts = list(dict.fromkeys(reversed(self.texts)))[:SHOWN]
        return f"mode {self.mode}, {state}{last}, newest texts {texts}"

    @property
    def mode(self) -> str:
        """The name of the vehicle's mode, as mavutil reads it from the heartbeat."""
        state = self.newest_state
        return "" if state is None else str(mavutil.mode_string_v10(state))

    @property
    def is_armed(self) -> bool:
        """Whether the newest heartbeat has the bit."""
        state = self.newest_state
        return state is not None and bool(state.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)

    @property
    def is_stopped(self) -> bool:
        """Whether the newest heartbeat tells the emergency stop."""
        return self.newest_state is not None and self.newest_state.system_status == EMERGENCY

    @property
    def place(self) -> Place:
        """Where the vehicle is."""
        found = self.newest["GLOBAL_POSITION_INT"]
        return Place(found.lat / DEG_E7, found.lon / DEG_E7)

    @property
    def speed_m_s(self) -> float:
        """How fast it drives."""
        return float(self.newest["VFR_HUD"].groundspeed)

    def is_at(self, place: Place) -> bool:
        """Whether it stands at a place."""
        return "GLOBAL_POSITION_INT" in self.newest and self.place.is_near(place)

    def fetch_parameters(self) -> None:
        """Ask for all parameters."""
        self.mav.param_request_list_send(1, 1)

    def set_parameter(self, name: str, value: float) -> None:
        """Set a parameter until its value is confirmed."""
        confirmed: list[float] = []
        self.handlers["PARAM_VALUE"] = lambda m: (
            confirmed.append(m.param_value) if m.param_id == name else None
        )
        kind = mavlink.MAV_PARAM_TYPE_REAL32
        try:
            self.repeat(
                lambda: self.mav.param_set_send(1, 1, name.encode(), value, kind),
                lambda: value in confirmed,
                f"{name} = {value}",
            )
        finally:
            self.handlers.clear()

    def set_mode(self, name: str) -> None:
        """Change the mode until a heartbeat shows it."""
        number = mavutil.mode_mapping_byname(mavlink.MAV_TYPE_GROUND_ROVER)[name]
        self.repeat(
            lambda: self.send_command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, number),
            lambda: self.mode == name,
            f"mode {name}",
        )

    def arm(self) -> None:
        """Arm until a heartbeat shows it."""
        self.repeat(
            lambda: self.send_command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0),
            lambda: self.is_armed,
            "armed",
        )

    def send_command(self, number: int, *params: float, confirmation: int = 0) -> None:
        """Send a COMMAND_LONG once."""
        values = (*params, *(0.0,) * (7 - len(params)))
        self.mav.command_long_send(1, 1, number, confirmation, *values)

    def command(self, number: int, *params: float, within_s: float = PATIENCE_S) -> int:
        """Send a COMMAND_LONG until it is acknowledged; return the result."""
        tries = 0

        def send() -> None:
            nonlocal tries
            self.send_command(number, *params, confirmation=tries)
            tries += 1

        self.newest.pop("COMMAND_ACK", None)
        self.repeat(send, lambda: self._result(number) is not None, f"an ack of {number}", within_s)
        return int(self.newest["COMMAND_ACK"].result)

    def require(self, number: int, *params: float) -> None:
        """Send a command that has to be accepted."""
        result = self.command(number, *params)
        if result != mavlink.MAV_RESULT_ACCEPTED:
            name = mavlink.enums["MAV_RESULT"][result].name
            raise StepError(f"command {number}: {name}, texts {self.texts[-3:]}")

    def upload(self, items: Sequence[Any], mission_type: int) -> None:
        """Upload items: a transfer that the vehicle leads."""
        done: list[int] = []
        asked: list[int] = []

        def answer(request: Any) -> None:
            if request.mission_type == mission_type and request.seq < len(items):
                asked.append(request.seq)
                self.mav.send(items[request.seq])

        def acknowledged(ack: Any) -> None:
            if ack.mission_type == mission_type:
                done.append(ack.type)

        self.handlers |= {
            "MISSION_REQUEST": answer,
            "MISSION_REQUEST_INT": answer,
            "MISSION_ACK": acknowledged,
        }

        def begin() -> None:
            if asked:  # the item or the acknowledgement of the last one was lost
                self.mav.send(items[asked[-1]])
            else:
                self.mav.mission_count_send(1, 1, len(items), mission_type)

        try:
            self.repeat(begin, lambda: done, "a MISSION_ACK")
        finally:
            self.handlers.clear()
        if done[0] != mavlink.MAV_MISSION_ACCEPTED:
            name = mavlink.enums["MAV_MISSION_RESULT"][done[0]].name
            raise StepError(f"upload: {name}, texts {self.texts[-3:]}")

    def download_log(self, path: Path) -> int:
        """Download the newest log by LOG_REQUEST_DATA; return its size."""
        self.newest.pop("LOG_ENTRY", None)
        send = self.mav
        self.repeat(
            lambda: send.log_request_list_send(1, 1, 0, 0xFFFF),
            lambda: "LOG_ENTRY" in self.newest,
            "a LOG_ENTRY",
        )
        entry = self.newest["LOG_ENTRY"]
        if not entry.num_logs:
            raise StepError("the vehicle has no logs")
        parts: dict[int, bytes] = {}
        self.handlers["LOG_DATA"] = lambda m: parts.update({m.ofs: bytes(m.data[: m.count])})
        wanted = range(0, entry.size, LOG_CHUNK)

        def ask() -> None:
            first = next(offset for offset in wanted if offset not in parts)
            send.log_request_data_send(1, 1, entry.id, first, entry.size - first)

        try:
            self.repeat(ask, lambda: all(offset in parts for offset in wanted), "the log", 40.0)
        finally:
            self.handlers.clear()
        send.log_request_end_send(1, 1)
        path.write_bytes(b"".join(parts[offset] for offset in wanted))
        return int(entry.size)

    def _result(self, number: int) -> int | None:
        ack = self.newest.get("COMMAND_ACK")
        return None if ack is None or ack.command != number else ack.result

    def take(self, message: Any) -> None:
        """Keep a message of the vehicle, and hand it to its handler."""
        name = message.get_type()
        if message.get_srcSystem() != 1 and not name.startswith("UNKNOWN_"):  # those have no sender
            return
        self.newest[name] = message
        self.counts[name] += 1
        if name == "STATUSTEXT":
            self.texts.append(message.text)
        if name == "HEARTBEAT":
            self.newest_state = message
        if name in self.handlers:
            self.handlers[name](message)


class Pilot(Station):
    """A connection of mavutil in one thread, with heartbeats; a silent one only listens."""

    def __init__(
        self, address: str, system: int = GROUND_STATION[0], *, is_silent: bool = False
    ) -> None:
        super().__init__()
        self.link: Any = mavutil.mavlink_connection(
            address, source_system=system, source_component=GROUND_STATION[1]
        )
        self.mav = self.link.mav
        self._is_silent = is_silent
        self._beat_s = 0.0

    def look(self) -> None:
        """Receive for a moment; send a heartbeat each second."""
        if not self._is_silent and time.monotonic() - self._beat_s >= 1.0:
            self._beat_s = time.monotonic()
            self.link.mav.heartbeat_send(
                mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0
            )
        message = self.link.recv_match(blocking=True, timeout=0.05)
        self.mav = self.link.mav  # mavutil makes a new one when it learns the protocol's version
        self.lost = self.link.mav_loss
        for _ in range(MAX_READ):  # on a busy computer they may come faster than they are read
            if message is None:
                break
            self.take(message)
            message = self.link.recv_match(blocking=False)


def item(
    seq: int, place: Place, command: int = 16, *, param1: float = 0.0, mission_type: int = 0
) -> Any:
    """Return a MISSION_ITEM_INT at a place."""
    x, y = (round(value * DEG_E7) for value in place)
    return mavlink.MAVLink_mission_item_int_message(
        1, 1, seq, GLOBAL, command, 0, 1, param1, 0, 0, 0, x, y, 0.0, mission_type
    )
