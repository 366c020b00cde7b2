"""The vehicle under test as the rows see it, the table of rows, and the verdict on each.

A row is a function that the decorator `row` enters into the table.
"""

from collections.abc import Callable, Mapping
from enum import StrEnum
from functools import cached_property, partial
from math import inf
from typing import Any, Final, NamedTuple, TypeAlias, TypeVar

from runtime.errors import RemoteError
from runtime.units import NS_PER_S
from vehicle_check.ground_stations import (
    Elapsed,
    GroundStation,
    GroundStations,
    Losses,
    ReceivedMessage,
    heartbeat,
    result_name,
)
from vehicle_check.mavlink_frames import NUMBERS, Signer, mavlink, timestamp_at
from vehicle_check.networks import VehicleNetwork

MAX_EVIDENCE: Final = 400
BUSY: Final = "this machine was busy for {:.2f} s of it: judge again when it is idle"


class RowStatus(StrEnum):
    """How a row ended."""

    PASS = "pass"
    FAIL = "fail"
    NOT_APPLICABLE = "not applicable"
    NOT_TRIED = "not tried"
    UNCERTAIN = "uncertain"


class VehicleProfile(StrEnum):
    """What a vehicle is judged as. Rows that its kind of vehicle does not follow are left out."""

    ROVER = "ardupilot-rover"
    ARDUPILOT = "ardupilot"
    PX4 = "px4"
    GENERIC = "generic"


ROVER: Final = frozenset({VehicleProfile.ROVER})
ARDUPILOTS: Final = frozenset({VehicleProfile.ROVER, VehicleProfile.ARDUPILOT})
EVERY_VEHICLE: Final = frozenset(VehicleProfile)


class RowVerdict(NamedTuple):
    """How a row ended, and the frames that show it."""

    status: RowStatus
    evidence: str


Judge: TypeAlias = Callable[["VehicleCheck"], RowVerdict]


class AcceptanceRow(NamedTuple):
    """A row of the acceptance list. `suffers` names the clients that a failure troubles.

    `source` names what the row follows, and `profiles` the vehicles that do.
    """

    number: int
    title: str
    suffers: str
    judge: Judge
    source: str
    profiles: frozenset[VehicleProfile] = EVERY_VEHICLE


ROWS: Final[dict[int, AcceptanceRow]] = {}


def row(
    number: int,
    title: str,
    *,
    suffers: str,
    source: str,
    profiles: frozenset[VehicleProfile] = EVERY_VEHICLE,
) -> Callable[[Judge], Judge]:
    """Enter a function into the table of rows."""

    def enter(judge: Judge) -> Judge:
        assert number not in ROWS
        ROWS[number] = AcceptanceRow(number, title, suffers, judge, source, profiles)
        return judge

    return enter


def passed(evidence: str) -> RowVerdict:
    """Return a pass."""
    return RowVerdict(RowStatus.PASS, evidence[:MAX_EVIDENCE])


def failed(evidence: str) -> RowVerdict:
    """Return a failure."""
    return RowVerdict(RowStatus.FAIL, evidence[:MAX_EVIDENCE])


def not_applicable(why: str) -> RowVerdict:
    """Return the verdict of a row that asks nothing of this vehicle."""
    return RowVerdict(RowStatus.NOT_APPLICABLE, why[:MAX_EVIDENCE])


def not_tried(why: str) -> RowVerdict:
    """Return the verdict of a row that the options exclude."""
    return RowVerdict(RowStatus.NOT_TRIED, why[:MAX_EVIDENCE])


class Findings:
    """The findings of one row: it passes if there is no fault, and nothing is in doubt or absent.

    In doubt is what the judge's own machine may have caused, absent is what the vehicle refuses
    because it does not have it.
    """

    def __init__(self) -> None:
        self._faults: list[str] = []
        self._doubts: list[str] = []
        self._absent: list[str] = []
        self._facts: list[str] = []

    def expect(self, is_right: object, fact: str) -> bool:
        """Keep the fact as a fault unless it is right."""
        (self._facts if is_right else self._faults).append(fact)
        return bool(is_right)

    def expect_in_time(self, elapsed: Elapsed, most_s: float, fact: str) -> bool:
        """Expect a time; do not charge the vehicle for that in which this machine was busy."""
        seconds, held_up_s = elapsed
        if seconds <= most_s or seconds - held_up_s > most_s:
            return self.expect(seconds <= most_s, fact)
        self._doubts.append(f"{fact}, but {BUSY.format(held_up_s)}")
        return True

    def absent(self, fact: str) -> None:
        """Keep what the vehicle does not have."""
        self._absent.append(fact)

    def fact(self, fact: str) -> None:
        """Keep a fact that is no fault."""
        self._facts.append(fact)

    def verdict(self) -> RowVerdict:
        """Return the verdict: the faults, or what is in doubt, or what is absent, or the facts."""
        if self._faults:
            return failed("; ".join(self._faults))
        if self._doubts:
            return RowVerdict(RowStatus.UNCERTAIN, "; ".join(self._doubts)[:MAX_EVIDENCE])
        if self._absent:
            return not_applicable("; ".join([*self._absent, *self._facts]))
        return passed("; ".join(self._facts))


HEARTBEAT_WITHIN_S: Final = 5.0
WINDOW_S: Final = 13.0
SETTLE_S: Final = 1.0
WATCHERS: Final = 4
STREAM_RATES: Final[Mapping[int, int]] = {1: 2, 2: 2, 3: 2, 6: 3, 10: 10, 11: 10, 12: 3}
"""Rates of REQUEST_DATA_STREAM by group, as QGroundControl's ArduPilot plugin asks for them."""
TOLERANCE: Final = 0.2
HARSH_LOSS: Final = 0.2
"""The share of frames that the judge drops in rows about a poor line."""
PERIODS: Final = 5
MIN_WATCH_S: Final = 2.0
SILENCE_S: Final = 10.0
"""A vehicle that has sent nothing for so long is gone."""
SET_MESSAGE_INTERVAL: Final = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
EMERGENCY: Final = mavlink.MAV_STATE_EMERGENCY
ONE_CLIENT: Final = "this endpoint serves one ground station"

Found = TypeVar("Found")


class CheckOptions(NamedTuple):
    """The options of the command line."""

    allow_motion: bool = False
    key: bytes | None = None
    loss: float = 0.0
    seed: int = 1
    unix_s: float = 1.8e9
    limit_s: float = inf
    profile: VehicleProfile = VehicleProfile.ROVER


class VehicleChange(NamedTuple):
    """What the check has changed: its name, and how to undo that; it returns True if it worked."""

    name: str
    undo: Callable[[], bool]


class StreamWindow(NamedTuple):
    """The frames of the main client while the judge only received.

    The first watcher remains connected, and never sends more than heartbeats.
    """

    frames: list[ReceivedMessage]
    seconds: float
    bytes_per_s: float
    watchers: list[GroundStation]
    silent: GroundStation
    began_ns: int


class VehicleCheck:
    """The vehicle under test, and values that several rows share."""

    def __init__(self, network: VehicleNetwork, options: CheckOptions) -> None:
        self.options = options
        self.station = GroundStations(network, Losses(options.loss, options.seed))
        self.began_ns = self.station.now_ns
        if options.key is not None:
            self.station.signer = self.signer_with(options.key)
        self.main = self.station.connect()
        self.restore: list[VehicleChange] = []
        self.was_stopped = False
        self.facts: dict[str, Any] = {}
        """Results of rows that other rows use."""

    def once(self, name: str, find: Callable[[], Found]) -> Found:
        """Return a fact of that name; find it at the first call."""
        if name not in self.facts:
            self.facts[name] = find()
        found: Found = self.facts[name]
        return found

    @property
    def target(self) -> int:
        """The system id of the vehicle."""
        return self.station.target

    @property
    def is_ardupilot(self) -> bool:
        """True if the vehicle is judged as one of ArduPilot."""
        return self.options.profile in ARDUPILOTS

    @property
    def is_rover(self) -> bool:
        """True if the vehicle is judged as a Rover of ArduPilot, whose modes the judge knows."""
        return self.options.profile is VehicleProfile.ROVER

    @property
    def spent_s(self) -> float:
        """The time since the start."""
        return (self.station.now_ns - self.began_ns) / NS_PER_S

    def stamp(self) -> int:
        """Return the time stamp of a signature now."""
        return timestamp_at(self.options.unix_s + self.spent_s)

    def signer_with(self, key: bytes) -> Signer:
        """Return a signer of a ground station."""
        return Signer(key, 1, self.stamp(), self.stamp)

    def find(self) -> None:
        """Wait for the vehicle's heartbeat; RemoteError if there is none."""
        since = self.main.mark()
        found = self.main.expect("HEARTBEAT", HEARTBEAT_WITHIN_S, is_vehicle, since)
        if found is None:
            other = f"; {self.main.malformed} malformed frames" if self.main.malformed else ""
            seconds = f"{HEARTBEAT_WITHIN_S:g} s"
            hint = "udpout and tcp connect to the vehicle, udpin waits for it"
            raise RemoteError(f"no heartbeat of a MAVLink vehicle within {seconds}{other}: {hint}")
        self.station.target = found.system
        self.station.target_component = found.component
        self.station.heard_ns = found.at_ns
        self.was_stopped = found.message.system_status == EMERGENCY
        mode = int(found.message.custom_mode)
        self.restore.append(VehicleChange(f"mode {mode}", partial(self._back_to, mode)))
        self.main.log[:] = [one for one in self.main.log if one.system == found.system]

    def _back_to(self, mode: int) -> bool:
        if self.mode != mode and not self.is_armed:
            return bool(self.set_mode(mode) == mavlink.MAV_RESULT_ACCEPTED)
        return self.mode == mode

    def is_silent(self) -> bool:
        """Wait for a vehicle that sends nothing; return True if it is gone."""
        before_ns = self.station.heard_ns
        left_s = SILENCE_S - (self.station.now_ns - before_ns) / NS_PER_S
        return not self.station.wait(left_s, lambda: self.station.heard_ns > before_ns)

    @cached_property
    def second(self) -> GroundStation:
        """A second ground station, which remains connected."""
        client = self.station.connect()
        client.greet()
        return client

    @property
    def serves_two(self) -> bool:
        """True if the vehicle sends to a second ground station, too. A serial line does not."""
        return not self.station.network.is_shared and bool(self.second.log)

    @cached_property
    def window(self) -> StreamWindow:
        """Receive the streams; request them first if the vehicle sends none."""
        began_ns = self.station.now_ns
        watchers = [self.station.connect() for _ in range(WATCHERS)]
        silent = self.station.connect(beats=False)
        silent.send_surely(heartbeat())
        self.station.wait(SETTLE_S)
        if not self.main.sent("GLOBAL_POSITION_INT"):
            self.ask_for_streams(self.main)
        since, bytes_before, start_ns = self.main.mark(), self.main.bytes, self.station.now_ns
        self.station.wait(WINDOW_S - SETTLE_S)
        seconds = (self.station.now_ns - start_ns) / NS_PER_S
        frames = self.main.log[since:]
        rate = (self.main.bytes - bytes_before) / seconds
        for one in watchers[1:]:
            one.beats = False
        return StreamWindow(frames, seconds, rate, watchers, silent, began_ns)

    def ask_for_streams(self, client: GroundStation) -> None:
        """Send REQUEST_DATA_STREAM for all groups."""
        target = self.station.address
        for group, rate in STREAM_RATES.items():
            client.send_surely(mavlink.MAVLink_request_data_stream_message(*target, group, rate, 1))

    def seen(self, name: str) -> list[ReceivedMessage]:
        """Return the messages of a name that the vehicle has sent in the window."""
        return [frame for frame in self.window.frames if frame.name == name]

    def rate(self, name: str) -> float:
        """Return the rate at which the vehicle sends in the window."""
        return len(self.seen(name)) / self.window.seconds

    def expect_rate(self, found: Findings, name: str, low_hz: float, high_hz: float) -> bool:
        """Expect a message in the window at a rate, with a tolerance.

        A vehicle that sends another rate by itself, as ArduPilot does, is asked for this one.
        """
        rate = self.rate(name)
        wanted = f"{low_hz:g}" if low_hz == high_hz else f"{low_hz:g}-{high_hz:g}"
        if _is_near(rate, low_hz, high_hz):
            return found.expect(True, f"{name} {rate:.1f} Hz (wanted {wanted})")
        asked = self._rate_when_asked(name, high_hz)
        fact = f"{name} {rate:.1f} Hz, {asked:.1f} Hz when asked (wanted {wanted})"
        return found.expect(_is_near(asked, low_hz, high_hz), fact)

    def refusal_of(self, number: int, *params: float) -> str:
        """Return how a vehicle refuses a command about something that it does not have.

        Empty if it accepts the command or does not answer. ArduPilot answers FAILED, not
        UNSUPPORTED, when it is asked for a message that it does not know.
        """
        result = self.main.result_of(number, *params)
        if result in (None, mavlink.MAV_RESULT_ACCEPTED):
            return ""
        return f"{number} with {params[0]:g}: {result_name(result)}"

    def _rate_when_asked(self, name: str, rate_hz: float) -> float:
        number = NUMBERS.get(name)
        interval_us = round(1e6 / rate_hz)
        result = number and self.main.result_of(SET_MESSAGE_INTERVAL, number, interval_us)
        if result != mavlink.MAV_RESULT_ACCEPTED:
            return 0.0
        seconds = max(MIN_WATCH_S, PERIODS / rate_hz)
        self.station.wait(1 / rate_hz)
        since = self.main.mark()
        self.station.wait(seconds)
        return len(self.main.sent(name, since)) / seconds

    def newest(self, name: str) -> Any:
        """Return the newest message of a name; None if there was none in or after the window."""
        since_ns = self.window.began_ns
        frame = self.main.latest(name)
        return frame.message if frame is not None and frame.at_ns >= since_ns else None

    @property
    def heartbeat(self) -> Any:
        """The vehicle's newest heartbeat."""
        frame = self.main.latest("HEARTBEAT", is_vehicle)
        assert frame is not None  # `find` has seen one
        return frame.message

    @property
    def mode(self) -> int:
        """The vehicle's present mode."""
        return int(self.heartbeat.custom_mode)

    @property
    def is_armed(self) -> bool:
        """True if the vehicle is armed."""
        return bool(self.heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)

    def set_mode(
        self, mode: int, client: GroundStation | None = None, within_s: float = 1.0
    ) -> int | None:
        """Change the mode by command 176; return its result."""
        client = client or self.main
        custom = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        return client.result_of(mavlink.MAV_CMD_DO_SET_MODE, custom, mode, within_s=within_s)

    def texts(self, since: int, client: GroundStation | None = None) -> str:
        """Return the STATUSTEXT that was sent since a mark, short."""
        frames = (client or self.main).sent("STATUSTEXT", since)
        return " | ".join(_text(frame.message.text) for frame in frames)


def is_vehicle(message: Any) -> bool:
    """Return True for the heartbeat of a vehicle, not of a ground station or a gimbal."""
    return bool(
        message.type != mavlink.MAV_TYPE_GCS and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID
    )


def _is_near(rate: float, low_hz: float, high_hz: float) -> bool:
    return low_hz * (1 - TOLERANCE) <= rate <= high_hz * (1 + TOLERANCE)


def _text(text: bytes | str) -> str:
    words = text.decode("utf-8", "replace") if isinstance(text, bytes) else text
    return words.rstrip("\0")
