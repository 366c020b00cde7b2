"""Watch any MAVLink vehicle without commanding it: what it sends, with rate, age and loss.

The watch sends heartbeats and requests to read: the parameters, the mission, and single messages
that the vehicle does not send by itself. With the last item of a mission it sends the
acknowledgement that ends the reading.
"""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum
from math import cos, isfinite, pi, radians
from struct import Struct
from typing import Any, Final, NamedTuple

from runtime.sequence import Order, order_of
from runtime.units import NS_PER_S
from vehicle_check.ground_stations import GroundStations, Losses, ReceivedMessage
from vehicle_check.mavlink_frames import NUMBERS, mavlink, number_of
from vehicle_check.networks import VehicleNetwork
from vehicle_check.row_steps import M_PER_E7_DEGREE
from vehicle_check.transfers import (
    MISSION,
    REQUEST_ITEM,
    ListedParameters,
    PlanItem,
    Value,
    missing,
)
from vehicle_check.vehicle_under_test import is_vehicle

RATE_S: Final = 5.0
"""The time over which rates and losses are counted."""
LATE_PERIODS: Final = 2.5
LEAST_LATE_S: Final = 1.0
MOST_LATE_S: Final = 5.0
MOST_TIMES: Final = 500
MODULUS: Final = 256
MAX_LATE_FRAMES: Final = 20
MOST_TEXTS: Final = 1_000
MOST_TRAIL: Final = 2_000
TRAIL_M: Final = 0.05
ASK_S: Final = 1.0
POLL_NS: Final = NS_PER_S // 10
UNANSWERED_NS: Final = NS_PER_S
REFUSED_AFTER: Final = 5
AT_ONCE: Final = 20
POLLED: Final = (
    "SYS_STATUS", "GLOBAL_POSITION_INT", "ATTITUDE", "VFR_HUD", "GPS_RAW_INT", "BATTERY_STATUS",
    "HOME_POSITION", "MISSION_CURRENT", "LOCAL_POSITION_NED", "GPS_GLOBAL_ORIGIN",
)  # fmt: skip
"""Messages that are asked for, one after the other, while the vehicle does not send them."""
LASTING_S: Final = {"GPS_GLOBAL_ORIGIN": 30.0, "HOME_POSITION": 10.0}
"""How long a value lasts that seldom changes; others are asked for again each second."""


class Freshness(Enum):
    """Whether a value may be shown as the present one."""

    LIVE = "live"
    STALE = "stale"
    NEVER = "never sent"


@dataclass
class WatchedMessage:
    """A kind of message of one component: the newest one, and when they came."""

    name: str
    component: int
    newest: Any = None
    count: int = 0
    times_ns: deque[int] = field(default_factory=lambda: deque(maxlen=MOST_TIMES))

    def take(self, frame: ReceivedMessage) -> None:
        """Keep a message."""
        self.newest = frame.message
        self.count += 1
        self.times_ns.append(frame.at_ns)

    def age_s(self, now_ns: int) -> float:
        """Return the age of the newest message."""
        return (now_ns - self.times_ns[-1]) / NS_PER_S

    def rate_hz(self, now_ns: int) -> float:
        """Return how often it came in the last seconds; 0 once it has stopped."""
        recent = [one for one in self.times_ns if now_ns - one <= RATE_S * NS_PER_S]
        if len(recent) < 2 or self.freshness(now_ns) is Freshness.STALE:
            return 0.0
        return (len(recent) - 1) * NS_PER_S / max(1, recent[-1] - recent[0])

    def freshness(self, now_ns: int) -> Freshness:
        """Return whether the newest message is as new as its usual period lets one expect."""
        times = self.times_ns
        period_s = 1.0
        if len(times) > 1:
            period_s = (times[-1] - times[0]) / (len(times) - 1) / NS_PER_S
        late_s = min(MOST_LATE_S, max(LEAST_LATE_S, LATE_PERIODS * period_s))
        return Freshness.LIVE if self.age_s(now_ns) <= late_s else Freshness.STALE


class SourceLoss:
    """Frames of one component, received and lost, of the last seconds and in all."""

    def __init__(self) -> None:
        self.received = self.lost = 0
        self._newest: int | None = None
        self._recent: deque[tuple[int, int]] = deque()

    def take(self, sequence: int, at_ns: int) -> None:
        """Count a frame, and those that its number shows as lost."""
        lost = 0
        if self._newest is not None:
            order = order_of(sequence, self._newest, MAX_LATE_FRAMES, modulus=MODULUS)
            if order is Order.NEWER:
                lost = (sequence - self._newest - 1) % MODULUS
            elif order is Order.LATE:
                lost = -1  # it was counted as lost
        if lost >= 0:
            self._newest = sequence
        self.received += 1
        self.lost = max(0, self.lost + lost)
        self._recent.append((at_ns, lost))

    def percent(self, now_ns: int) -> float | None:
        """Return the share of the last seconds that was lost; None without a frame in them."""
        while self._recent and now_ns - self._recent[0][0] > RATE_S * NS_PER_S:
            self._recent.popleft()
        lost = max(0, sum(one for _, one in self._recent))
        return 100.0 * lost / (lost + len(self._recent)) if self._recent else None


class VehicleText(NamedTuple):
    """A text of the vehicle, its severity, and its time after the start of the watch."""

    at_s: float
    severity: int
    text: str


class Place(NamedTuple):
    """A place on the map: east and north in metres."""

    x_m: float
    y_m: float


class VehicleWatch:
    """One vehicle, followed from its first heartbeat. `poll` exchanges what is due."""

    def __init__(
        self,
        network: VehicleNetwork,
        system: int = 0,
        take: Callable[[bytes, int], None] = lambda frame, at_ns: None,
    ) -> None:
        self.stations = GroundStations(network, Losses(0.0, 1))
        self.began_ns = self.stations.now_ns
        self.messages: dict[tuple[int, str], WatchedMessage] = {}
        self.losses: dict[int, SourceLoss] = {}
        self.texts: deque[VehicleText] = deque(maxlen=MOST_TEXTS)
        self.parameters = ListedParameters()
        self.mission: list[PlanItem | None] | None = None
        self.trail: deque[Place] = deque(maxlen=MOST_TRAIL)
        self.on_frame = take
        self._system = system
        self._client = self.stations.connect()
        self._chunks: dict[tuple[int, int], dict[int, str]] = {}
        self._asks = _Requests(self)

    @property
    def now_ns(self) -> int:
        """The time."""
        return self.stations.now_ns

    @property
    def system(self) -> int:
        """The system id of the vehicle; 0 until it is heard."""
        return self.stations.target

    @property
    def client_system(self) -> int:
        """The system id of the watch itself."""
        return self._client.system

    def poll(self) -> None:
        """Exchange what is due, without waiting."""
        self.stations.exchange(self.now_ns)
        frames, self._client.log = self._client.log, []
        for frame in frames:
            if not self.system:
                self._find(frame)
            self.on_frame(frame.raw, frame.at_ns)
            if frame.system == self.system:
                self._take(frame)
        if self.system:
            self._asks.send_due(self.now_ns)

    def send(self, message: Any) -> None:
        """Send a request to read."""
        self._client.send(message)

    def read_again(self) -> None:
        """Read parameters and mission again."""
        self._asks.read_again()

    def _find(self, frame: ReceivedMessage) -> None:
        is_wanted = self._system in (0, frame.system)
        if frame.name == "HEARTBEAT" and is_wanted and is_vehicle(frame.message):
            self.stations.target, self.stations.target_component = frame.system, frame.component

    def _take(self, frame: ReceivedMessage) -> None:
        key = frame.component, frame.name
        if key not in self.messages:
            self.messages[key] = WatchedMessage(frame.name, frame.component)
        self.messages[key].take(frame)
        self.losses.setdefault(frame.component, SourceLoss()).take(frame.sequence, frame.at_ns)
        if frame.name == "STATUSTEXT":
            self._take_text(frame)
        elif frame.name in ("LOCAL_POSITION_NED", "GLOBAL_POSITION_INT"):
            self._extend_trail()
        self._asks.take(frame)

    def _take_text(self, frame: ReceivedMessage) -> None:
        one = frame.message
        raw = one.text.encode() if isinstance(one.text, str) else bytes(one.text)
        text = raw.rstrip(b"\0").decode("utf-8", "replace")
        number = int(getattr(one, "id", 0))
        if number:
            chunks = self._chunks.setdefault((frame.component, number), {})
            chunks[int(one.chunk_seq)] = text
            if len(raw.rstrip(b"\0")) == CHUNK:
                return  # more follows
            text = "".join(chunks[at] for at in sorted(chunks))
            del self._chunks[frame.component, number]
        at_s = (frame.at_ns - self.began_ns) / NS_PER_S
        self.texts.append(VehicleText(at_s, int(one.severity), text))

    def _extend_trail(self) -> None:
        place = self.place()
        if place is None:
            return
        last = self.trail[-1] if self.trail else None
        if last is None or max(abs(place.x_m - last.x_m), abs(place.y_m - last.y_m)) >= TRAIL_M:
            self.trail.append(place)

    # What is shown.

    def number(self, one: Value) -> float:
        """Return the value of a parameter; PX4 sends the bytes of an integer as a float."""
        beat = self.newest("HEARTBEAT")
        is_bytewise = beat is not None and beat.autopilot == mavlink.MAV_AUTOPILOT_PX4
        if is_bytewise and one.kind == mavlink.MAV_PARAM_TYPE_INT32:
            return int(INT32.unpack(REAL32.pack(one.value))[0])
        return one.value

    def seen(self, name: str) -> WatchedMessage | None:
        """Return a message of the autopilot; None if it was never sent."""
        return self.messages.get((self.stations.target_component, name))

    def freshness(self, name: str) -> Freshness:
        """Return whether a message of the autopilot may be shown as the present one."""
        one = self.seen(name)
        return Freshness.NEVER if one is None else one.freshness(self.now_ns)

    def newest(self, name: str) -> Any:
        """Return the newest message of a name, however old; None if it was never sent."""
        one = self.seen(name)
        return None if one is None else one.newest

    def loss_percent(self) -> float | None:
        """Return the loss of the autopilot in the last seconds; None if nothing arrives."""
        loss = self.losses.get(self.stations.target_component)
        return None if loss is None else loss.percent(self.now_ns)

    def origin(self) -> tuple[int, int] | None:
        """Return latitude and longitude of the place 0 0 of the map.

        It is that of LOCAL_POSITION_NED if the vehicle tells it, or where the vehicle was first.
        """
        told = self.newest("GPS_GLOBAL_ORIGIN")
        if told is not None:
            return int(told.latitude), int(told.longitude)
        here, local = self.newest("GLOBAL_POSITION_INT"), self.newest("LOCAL_POSITION_NED")
        if here is None or (here.lat == 0 and here.lon == 0):
            return None
        if local is None:
            if self._first is None:
                self._first = int(here.lat), int(here.lon)
            return self._first
        shrink = cos(radians(here.lat / 1e7))
        north, east = local.x / M_PER_E7_DEGREE, local.y / M_PER_E7_DEGREE / shrink
        return round(here.lat - north), round(here.lon - east)

    _first: tuple[int, int] | None = None

    def place(self) -> Place | None:
        """Return the newest position on the map; None if none was sent or it is not a number."""
        local = self.newest("LOCAL_POSITION_NED")
        if local is not None:
            is_known = isfinite(local.x) and isfinite(local.y)
            return Place(float(local.y), float(local.x)) if is_known else None
        here = self.newest("GLOBAL_POSITION_INT")
        return None if here is None else self.place_of(here.lat, here.lon)

    @property
    def has_live_place(self) -> bool:
        """True while the position is not stale."""
        local = self.freshness("LOCAL_POSITION_NED")
        is_used = self.freshness("GLOBAL_POSITION_INT") if local is Freshness.NEVER else local
        return is_used is Freshness.LIVE

    def place_of(self, lat: int, lon: int) -> Place | None:
        """Return a latitude and longitude on the map; None without an origin."""
        origin = self.origin()
        if origin is None or (lat == 0 and lon == 0):
            return None
        shrink = cos(radians(origin[0] / 1e7))
        return Place(
            (lon - origin[1]) * M_PER_E7_DEGREE * shrink, (lat - origin[0]) * M_PER_E7_DEGREE
        )

    def heading_rad(self) -> float | None:
        """Return the heading from the x axis of the map, counter-clockwise."""
        attitude = self.newest("ATTITUDE")
        if attitude is not None and isfinite(attitude.yaw):
            return pi / 2 - float(attitude.yaw)
        here = self.newest("GLOBAL_POSITION_INT")
        if here is None or here.hdg == UNKNOWN:
            return None
        return pi / 2 - radians(here.hdg / 100)


CHUNK: Final = 50
UNKNOWN: Final = 65_535


class _Requests:
    """The requests of the watch: parameters, then the mission, and single messages."""

    def __init__(self, watch: VehicleWatch) -> None:
        self._watch = watch
        self._parameters_ns = self._mission_ns = self._message_ns = 0
        self._parameter_tries = self._mission_tries = 0
        self._polled = list(POLLED)
        self._asked = ""
        self._is_listed = self._is_read = False

    def take(self, frame: ReceivedMessage) -> None:
        """Take the answers."""
        watch, one = self._watch, frame.message
        if frame.name == "PARAM_VALUE":
            watch.parameters.take(one)
            self._parameters_ns, self._parameter_tries = frame.at_ns, 0
        elif frame.name == "COMMAND_ACK" and one.command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            if one.result != mavlink.MAV_RESULT_ACCEPTED and self._asked in self._polled:
                self._polled.remove(self._asked)
            self._asked = ""
        elif getattr(one, "mission_type", MISSION) == MISSION:
            self._take_plan(frame.name, one)

    def _take_plan(self, name: str, one: Any) -> None:
        watch = self._watch
        if name == "MISSION_COUNT" and not self._is_read:
            watch.mission = [None] * min(int(one.count), MAX_ITEMS)
            self._mission_tries = 0
            self._ask_item()
        elif name == "MISSION_ITEM_INT" and watch.mission is not None and not self._is_read:
            if int(one.seq) < len(watch.mission):
                params = (one.param1, one.param2, one.param3, one.param4)
                item = PlanItem(one.command, one.x, one.y, one.frame, params, one.z)
                watch.mission[int(one.seq)] = item
                self._mission_tries = 0
            self._ask_item()

    def _ask_item(self) -> None:
        """Ask for the first item that is missing; end the reading if there is none."""
        watch = self._watch
        assert watch.mission is not None, "the count is known"
        target = watch.stations.address
        self._mission_ns = watch.now_ns
        seq = next((at for at, one in enumerate(watch.mission) if one is None), None)
        if seq is None:
            self._is_read = True
            watch.send(mavlink.MAVLink_mission_ack_message(*target, 0, MISSION))
        else:
            watch.send(REQUEST_ITEM(*target, seq, MISSION))

    def read_again(self) -> None:
        """Read parameters and mission again."""
        self._watch.parameters, self._watch.mission = ListedParameters(), None
        self._is_listed = self._is_read = False
        self._parameter_tries = self._mission_tries = 0

    def send_due(self, now_ns: int) -> None:
        """Send what is due, the mission after the parameters."""
        if not self._send_parameters(now_ns):
            self._send_mission(now_ns)
        if now_ns - self._message_ns >= (UNANSWERED_NS if self._asked else POLL_NS):
            self._send_message(now_ns)

    def _send_parameters(self, now_ns: int) -> bool:
        """Ask for the list, then for what is missing; return False if there is nothing to ask."""
        watch, target = self._watch, self._watch.stations.address
        if watch.parameters.is_whole or self._parameter_tries >= REFUSED_AFTER:
            return False
        if now_ns - self._parameters_ns < ASK_S * NS_PER_S:
            return True
        self._parameters_ns = now_ns
        self._parameter_tries += 1
        if not watch.parameters.count:
            watch.send(mavlink.MAVLink_param_request_list_message(*target))
        for index in missing(watch.parameters)[:AT_ONCE]:
            watch.send(mavlink.MAVLink_param_request_read_message(*target, b"", index))
        return True

    def _send_mission(self, now_ns: int) -> None:
        watch, target = self._watch, self._watch.stations.address
        is_waiting = now_ns - self._mission_ns < ASK_S * NS_PER_S
        if self._is_read or is_waiting or self._mission_tries >= REFUSED_AFTER:
            return
        self._mission_tries += 1
        if watch.mission is None:
            self._mission_ns = now_ns
            watch.send(mavlink.MAVLink_mission_request_list_message(*target, MISSION))
        else:
            self._ask_item()

    def _send_message(self, now_ns: int) -> None:
        """Ask for the next message that the vehicle does not send by itself."""
        self._asked = ""
        for _ in range(len(self._polled)):
            name = self._polled.pop(0)
            self._polled.append(name)
            one = self._watch.seen(name)
            if one is None or one.age_s(now_ns) >= LASTING_S.get(name, ASK_S):
                command, target = mavlink.MAV_CMD_REQUEST_MESSAGE, self._watch.stations.address
                asked = (float(NUMBERS[name]), *[0.0] * 6)
                self._watch.send(mavlink.MAVLink_command_long_message(*target, command, 0, *asked))
                self._asked, self._message_ns = name, now_ns
                return


INT32, REAL32 = Struct("<i"), Struct("<f")
MAX_ITEMS: Final = 2_000
MODE_ENUMS: Final = {
    "ROVER_MODE": (mavlink.MAV_TYPE_GROUND_ROVER, mavlink.MAV_TYPE_SURFACE_BOAT),
    "SUB_MODE": (mavlink.MAV_TYPE_SUBMARINE,),
    "TRACKER_MODE": (mavlink.MAV_TYPE_ANTENNA_TRACKER,),
    "PLANE_MODE": (mavlink.MAV_TYPE_FIXED_WING, *range(19, 26)),
    "COPTER_MODE": (2, 3, 4, 13, 14, 15, 29),
}
PX4_MODES: Final = (
    "", "MANUAL", "ALTCTL", "POSCTL", "AUTO", "ACRO", "OFFBOARD", "STABILIZED", "RATTITUDE",
)  # fmt: skip
PX4_AUTO: Final = (
    "", "READY", "TAKEOFF", "LOITER", "MISSION", "RTL", "LAND", "RTGS", "FOLLOW", "PRECLAND",
)  # fmt: skip


def mode_name(heartbeat: Any) -> str:
    """Return the name of a mode of ArduPilot or PX4, else its number."""
    number = int(heartbeat.custom_mode)
    if heartbeat.autopilot == mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA:
        for name, kinds in MODE_ENUMS.items():
            if heartbeat.type in kinds and number in mavlink.enums[name]:
                return str(mavlink.enums[name][number].name.removeprefix(f"{name}_"))
    if heartbeat.autopilot == mavlink.MAV_AUTOPILOT_PX4:
        main, sub = number >> 16 & 0xFF, number >> 24
        if main == PX4_MODES.index("AUTO") and 0 < sub < len(PX4_AUTO):
            return f"AUTO {PX4_AUTO[sub]}"
        if 0 < main < len(PX4_MODES):
            return PX4_MODES[main]
    return f"mode {number}"


def enum_name(kind: str, number: int) -> str:
    """Return the name of an enumeration's value in words, else its number."""
    entry = mavlink.enums[kind].get(number)
    return str(number) if entry is None else entry.name.removeprefix(f"{kind}_").lower()


def vehicle_name(heartbeat: Any) -> str:
    """Return what a heartbeat says of the vehicle, in words."""
    autopilot = enum_name("MAV_AUTOPILOT", heartbeat.autopilot).replace(
        "ardupilotmega", "ArduPilot"
    )
    words = f"{autopilot.replace('px4', 'PX4')} {enum_name('MAV_TYPE', heartbeat.type)}"
    return words.replace("_", " ")


def is_armed(heartbeat: Any) -> bool:
    """Return True for the heartbeat of an armed vehicle."""
    return bool(heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)


def is_secret(frame: bytes) -> bool:
    """Return True for a frame with the key of a signed link."""
    return bool(number_of(frame) == mavlink.MAVLINK_MSG_ID_SETUP_SIGNING)


def command_name(number: int) -> str:
    """Return the name of a command of a mission item."""
    entry = mavlink.enums["MAV_CMD"].get(number)
    return str(number) if entry is None else str(entry.name.removeprefix("MAV_CMD_"))


def sorted_messages(watch: VehicleWatch) -> Sequence[WatchedMessage]:
    """Return all kinds of messages, by component and name."""
    return [watch.messages[key] for key in sorted(watch.messages)]
