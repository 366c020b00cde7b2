"""One run of the judge: connect, judge the rows, restore changed values and plans."""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property, partial
from typing import Any, Final, NamedTuple

from ground.vehicle_check.dialect import mavlink
from ground.vehicle_check.network import Losses, Network
from ground.vehicle_check.session import Client, Frame, Station
from ground.vehicle_check.signing import Signer, timestamp_at
from ground.vehicle_check.verdict import Findings, Row, Verdict, failed, not_tried
from runtime.errors import RemoteError
from runtime.units import NS_PER_S

HEARTBEAT_WITHIN_S: Final = 5.0
WINDOW_S: Final = 13.0
SETTLE_S: Final = 1.0
WATCHERS: Final = 4
STREAM_RATES: Final[Mapping[int, int]] = {1: 2, 2: 2, 3: 2, 6: 3, 10: 10, 11: 10, 12: 3}
"""Rates of REQUEST_DATA_STREAM by group, as QGroundControl's ArduPilot plugin asks for them."""
TOLERANCE: Final = 0.2
MAX_RUN_S: Final = 85.0
MAX_RUN_WITH_MOTION_S: Final = 300.0


class Options(NamedTuple):
    """The options of the command line."""

    allow_motion: bool = False
    key: bytes | None = None
    loss: float = 0.0
    seed: int = 1
    unix_s: float = 1.8e9


class Judged(NamedTuple):
    """A row with its verdict."""

    row: Row
    verdict: Verdict


class Window(NamedTuple):
    """The frames of the main client while the judge only received."""

    frames: list[Frame]
    seconds: float
    bytes_per_s: float
    watchers: list[Client]
    silent: Client
    began_ns: int


class Check:
    """The vehicle under test, and values that several rows share."""

    def __init__(self, network: Network, options: Options) -> None:
        self.options = options
        self.station = Station(network, Losses(options.loss, options.seed))
        if options.key is not None:
            self.station.signer = Signer(options.key, 1, timestamp_at(options.unix_s))
        self.main = self.station.connect()
        self.began_ns = self.station.now_ns
        self.restore: list[Callable[[], None]] = []
        self.facts: dict[str, Any] = {}
        """Results of rows that other rows use."""

    @property
    def target(self) -> int:
        """The system id of the vehicle."""
        return self.station.target

    @property
    def spent_s(self) -> float:
        """The time since the start."""
        return (self.station.now_ns - self.began_ns) / NS_PER_S

    def find(self) -> None:
        """Wait for the vehicle's heartbeat; RemoteError if there is none."""
        since = self.main.mark()
        found = self.main.expect("HEARTBEAT", HEARTBEAT_WITHIN_S, is_vehicle, since)
        if found is None:
            other = f"; {self.main.malformed} malformed frames" if self.main.malformed else ""
            seconds = f"{HEARTBEAT_WITHIN_S:g} s"
            raise RemoteError(f"no heartbeat of a MAVLink vehicle within {seconds}{other}")
        self.station.target = found.system
        self.station.target_component = found.component
        self.restore.append(partial(self._back_to, int(found.message.custom_mode)))
        self.main.log[:] = [one for one in self.main.log if one.system == found.system]

    def _back_to(self, mode: int) -> None:
        if self.mode != mode and not self.is_armed:
            self.set_mode(mode)

    @cached_property
    def second(self) -> Client:
        """A second ground station, which remains connected."""
        client = self.station.connect()
        self.station.wait(0.3)
        return client

    @cached_property
    def window(self) -> Window:
        """Receive the streams; request them first if the vehicle sends none."""
        began_ns = self.station.now_ns
        watchers = [self.station.connect() for _ in range(WATCHERS)]
        silent = self.station.connect(beats=False)
        silent.beats = True
        silent.beat(began_ns)
        silent.beats = False
        self.station.wait(SETTLE_S)
        if not self.main.heard("GLOBAL_POSITION_INT"):
            self.ask_for_streams(self.main)
        since, bytes_before, start_ns = self.main.mark(), self.main.bytes, self.station.now_ns
        self.station.wait(WINDOW_S - SETTLE_S)
        seconds = (self.station.now_ns - start_ns) / NS_PER_S
        frames = self.main.log[since:]
        rate = (self.main.bytes - bytes_before) / seconds
        for one in watchers:
            one.beats = False
        return Window(frames, seconds, rate, watchers, silent, began_ns)

    def ask_for_streams(self, client: Client) -> None:
        """Send REQUEST_DATA_STREAM for all groups."""
        target = self.target, self.station.target_component
        for group, rate in STREAM_RATES.items():
            client.send(mavlink.MAVLink_request_data_stream_message(*target, group, rate, 1))

    def seen(self, name: str) -> list[Frame]:
        """Return the messages of a name in the window."""
        return [one for one in self.window.frames if one.name == name and not one.is_lost]

    def rate(self, name: str, since: int | None = None, seconds: float = 0.0) -> float:
        """Return the rate at which the vehicle sends in the window, or since a mark."""
        if since is None:
            frames, seconds = self.window.frames, self.window.seconds
        else:
            frames = self.main.log[since:]
        return sum(one.name == name for one in frames) / seconds

    def expect_rate(self, found: Findings, name: str, low_hz: float, high_hz: float) -> bool:
        """Expect a message in the window at a rate, with a tolerance."""
        rate = self.rate(name)
        is_right = low_hz * (1 - TOLERANCE) <= rate <= high_hz * (1 + TOLERANCE)
        wanted = f"{low_hz:g}" if low_hz == high_hz else f"{low_hz:g}-{high_hz:g}"
        return found.expect(is_right, f"{name} {rate:.1f} Hz (wanted {wanted})")

    def newest(self, name: str) -> Any:
        """Return the newest message of a name in the window; None if there is none."""
        frames = self.seen(name)
        return frames[-1].message if frames else None

    @property
    def heartbeat(self) -> Any:
        """The vehicle's newest heartbeat."""
        frames = self.main.heard("HEARTBEAT", where=is_vehicle)
        return frames[-1].message

    @property
    def mode(self) -> int:
        """The vehicle's present mode."""
        return int(self.heartbeat.custom_mode)

    @property
    def is_armed(self) -> bool:
        """True if the vehicle is armed."""
        return bool(self.heartbeat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)

    def set_mode(self, mode: int, client: Client | None = None) -> int | None:
        """Change the mode by command 176; return its result."""
        client = client or self.main
        return client.result_of(
            mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED, mode
        )

    def texts(self, since: int, client: Client | None = None) -> str:
        """Return the STATUSTEXT since a mark, short."""
        frames = (client or self.main).heard("STATUSTEXT", since)
        return " | ".join(_text(one.message.text) for one in frames)


def is_vehicle(message: Any) -> bool:
    """Return True for the heartbeat of a vehicle, not of a ground station or a gimbal."""
    return bool(
        message.type != mavlink.MAV_TYPE_GCS and message.autopilot != mavlink.MAV_AUTOPILOT_INVALID
    )


def judge(
    network: Network,
    options: Options,
    rows: Sequence[Row],
    progress: Callable[[str], None] = lambda text: None,
) -> list[Judged]:
    """Judge a vehicle; RemoteError if there is none. Return the rows in the order of numbers."""
    check = Check(network, options)
    check.find()
    most_s = MAX_RUN_WITH_MOTION_S if options.allow_motion else MAX_RUN_S
    found = []
    for row in rows:
        progress(f"row {row.number}: {row.title}")
        if check.spent_s > most_s:
            found.append(Judged(row, not_tried(f"the check takes {most_s:g} s at most")))
            continue
        found.append(Judged(row, _judged(row, check)))
    for undo in reversed(check.restore):
        undo()
    return sorted(found, key=lambda one: one.row.number)


def _judged(row: Row, check: Check) -> Verdict:
    try:
        return row.judge(check)
    except (AttributeError, IndexError, KeyError, ValueError, OverflowError, TypeError) as error:
        # A hostile vehicle must not end the judge: rows receive its values unchecked.
        return failed(f"unusable answer: {type(error).__name__}: {error}")


def _text(text: bytes | str) -> str:
    words = text.decode("utf-8", "replace") if isinstance(text, bytes) else text
    return words.rstrip("\0")
