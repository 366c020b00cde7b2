"""Figures of the MAVLink gateway, each measured in one run beside what it is compared with.

- Cost: CPU time and memory, with one robot that drives, one client and default rates.
- Line: bytes per second and regular streams at 57,600 baud, while parameters are read.
- Ready: the time until a client has heartbeat, all parameters, the mission and the home, with lost
  frames. It asks for all three at once, and repeats a request without an answer after a second, as
  MAVProxy and the loops of mavutil scripts do. Parameters come as the file of MAVProxy and Mission
  Planner, by pymavlink's own FTP client, or as the list of PARAM_VALUE.
- Flood: missed ticks, the owner's emergency stop and memory in floods of frames while the robot
  drives. The sender runs on this machine and takes processor time itself. So the same floods are
  also sent to a socket that no process reads. It is a process,
  `python -m checks.speed.gateway.gateway_figures KIND RATE PEERS PORT`, that prints `ready`, begins
  at the first line of its standard input, and prints how many frames it has sent when that ends.
"""

import argparse
import socket
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from itertools import cycle, pairwise
from queue import Empty, SimpleQueue
from random import Random
from threading import Event, Thread
from time import monotonic
from typing import Any, Final

from pymavlink import mavftp

from checks.flood.under_attack import peak_mb
from checks.harness.figures import BenchmarkReport, Figure, figure
from checks.harness.mavlink_client import (
    GROUND_STATION,
    FrameArrival,
    Line,
    MavlinkClient,
    PseudoLine,
    UdpLine,
)
from checks.harness.observer import motion_since, stood_s
from checks.harness.processes import ToldProcess, cpu_s, resident_mb, send_when_told
from checks.harness.relays import PERFECT, POOR, Impairment, UdpRelay
from checks.harness.until import until
from checks.speed.gateway import forgery, reactions
from checks.speed.gateway.forgery import command, commands
from checks.speed.gateway.stage import Air, Driver, Figures, on_air
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from runtime.units import NS_PER_S

MIXED: Final = "mixed"
SUPPLY: Final = 500
SYSTEM: Final = 200
NOBODY: Final = 55_555
"""The id of a message that no dialect has."""


def packed(messages: Sequence[Any]) -> Iterator[bytes]:
    """Yield the frames of messages again and again, with rising sequence numbers."""
    encoder = mavlink.MAVLink(None, SYSTEM, 190)
    for message in cycle(messages):
        encoder.seq = (encoder.seq + 1) & 0xFF
        yield bytes(message.pack(encoder))


def valid(random: Random) -> Iterator[bytes]:
    """Yield requests that a gateway answers, and commands that it has to refuse."""
    beat = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
    reads = [mavlink.MAVLink_param_request_read_message(1, 1, b"", n) for n in range(20)]
    asks = [
        mavlink.MAVLink_param_request_list_message(1, 1),
        mavlink.MAVLink_mission_request_list_message(1, 1),
        mavlink.MAVLink_timesync_message(0, 1),
        mavlink.MAVLink_ping_message(1, 1, 1, 1),
        command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION),
    ]
    stops = (mavlink.MAV_CMD_DO_FLIGHTTERMINATION, mavlink.MAV_CMD_COMPONENT_ARM_DISARM)
    orders = [  # an emergency stop is open to all: it would end the drive
        one for one in commands((0, 0)) if getattr(one, "command", 0) not in stops
    ]
    moves = [
        one
        for one in orders
        if one.get_type() != "SETUP_SIGNING"
        and not (getattr(one, "param2", None) == 4.0 or getattr(one, "custom_mode", None) == 4)
    ]
    return packed([beat, *reads, *asks, *moves])


def broken(random: Random) -> Iterator[bytes]:
    """Yield frames with a wrong byte, cut frames, and noise that begins like a frame."""
    for frame in valid(random):
        data, way = bytearray(frame), random.randrange(3)
        if way == 0:
            data[random.randrange(1, len(data))] ^= 1 + random.randrange(255)
        elif way == 1:
            del data[random.randrange(1, len(data)) :]
        else:
            data = bytearray((mavlink.PROTOCOL_MARKER_V2,)) + random.randbytes(60)
        yield bytes(data)


def unknown(random: Random) -> Iterator[bytes]:
    """Yield frames of messages that no dialect has."""
    for frame in valid(random):
        data = bytearray(frame)
        data[7:10] = (NOBODY + random.randrange(1000)).to_bytes(3, "little")
        yield bytes(data)


KINDS: Final[Mapping[str, Callable[[Random], Iterator[bytes]]]] = {
    "valid": valid,
    "broken": broken,
    "unknown": unknown,
}


def supply_of(kind: str) -> list[bytes]:
    """Return frames of a kind, or of all kinds in turn."""
    random = Random(1)
    chosen = [KINDS[kind]] if kind != MIXED else list(KINDS.values())
    sources = [make(random) for make in chosen]
    return [next(source) for _ in range(SUPPLY) for source in sources]


def send_flood(kind: str, rate_hz: float, peers: int, port: int) -> None:
    """Send at a rate, from so many sockets in turn, when told; print how many frames."""
    sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in range(peers)]
    for one in sockets:
        one.connect(("127.0.0.1", port))
        one.setblocking(False)
    pairs = zip(cycle(supply_of(kind)), cycle(sockets), strict=False)

    def send() -> None:
        frame, one = next(pairs)
        with suppress(OSError):
            one.send(frame)

    print(send_when_told(send, rate_hz), flush=True)


CROWD: Final = 16
STOP_AT_MOST_MS: Final = 500.0
GROWN_AT_MOST_MB: Final = 10.0
SETTLE_S: Final = 2.0
STOP_S: Final = 20.0


@dataclass
class FrameFloodRun:
    """A drive in a flood."""

    missed: int = 0
    ticks: int = 0
    cpu_percent: float = 0.0
    grown_mb: float = 0.0
    peak_mb: float = 0.0
    rate_hz: float = 0.0
    stops_ms: list[float] = field(default_factory=list)


def flood_figures(options: argparse.Namespace) -> Figures:
    """Flood with each kind of frames, from one and from many peers."""
    figures: list[Figure] = []
    for peers in (1, CROWD):
        for kind in options.kinds:
            name = f"{kind}, {peers} {'peers' if peers > 1 else 'peer'}"
            print(f"{name} ...", file=sys.stderr, flush=True)
            figures += flood_figures_of(name, run_flood(options, kind, peers, is_dummy=False))
        name = f"socket without a reader, {peers}"
        figures += flood_figures_of(name, run_flood(options, MIXED, peers, is_dummy=True))
    return figures, [
        f"flood: {options.rate:g} frames/s for {options.drive:g} s of driving and"
        f" {options.presses} emergency stops each; the sender has a lower priority, but takes a"
        " part of the two cores",
        "emergency stop: from the first send of MAV_CMD_DO_FLIGHTTERMINATION by the owner, which"
        " repeats it every 0.5 s, to wheels at rest by the plant's truth",
    ]


def run_flood(
    options: argparse.Namespace, kind: str, peers: int, *, is_dummy: bool
) -> FrameFloodRun:
    """Drive, then stop several times, in a flood at the gateway or at another socket."""
    found = FrameFloodRun()
    with ExitStack() as scope:
        air = scope.enter_context(on_air())
        client = scope.enter_context(MavlinkClient(air.line()))
        driver = Driver(client, air)
        driver.take()
        driver.drive(SETTLE_S)
        dummy = scope.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
        dummy.bind(("127.0.0.1", 0))
        port = dummy.getsockname()[1] if is_dummy else air.port
        before_mb, missed, ticks = peak_mb(air.pid), air.missed, air.ticks
        begun_s, begun_cpu_s = monotonic(), cpu_s(air.pid)
        words = (kind, str(options.rate), str(peers), str(port))
        with ToldProcess(__name__, *words, is_nice=True) as flood:
            flood.go()
            driver.drive(options.drive)
            for _ in range(options.presses):
                driver.set_off()
                found.stops_ms.append(stop_ms(air, client))
            took_s = monotonic() - begun_s
        found.rate_hz = int(flood.last) / took_s
        found.cpu_percent = 100.0 * (cpu_s(air.pid) - begun_cpu_s) / took_s
        found.peak_mb = peak_mb(air.pid)
        found.grown_mb = found.peak_mb - before_mb
        found.missed, found.ticks = air.missed - missed, air.ticks - ticks
    return found


def stop_ms(air: Air, client: MavlinkClient) -> float:
    """Send the emergency stop as the owner; return the time in ms until the wheels stand."""
    sent_ns = client.command(mavlink.MAV_CMD_DO_FLIGHTTERMINATION, 1.0)
    until(
        lambda: stood_s(motion_since(air.observer.truths, sent_ns)) is not None,
        "wheels at rest",
        STOP_S,
    )
    Event().wait(SETTLE_S / 10)
    return (stood_s(motion_since(air.observer.truths, sent_ns)) or 0.0) * 1e3


def flood_figures_of(name: str, found: FrameFloodRun) -> list[Figure]:
    """Return the figures of a run."""
    return [
        figure(f"{name}: ticks missed of {found.ticks}", found.missed, at_most=0.0),
        figure(f"{name}: stop to wheels at rest", found.stops_ms, "ms"),
        figure(f"{name}: the same, worst", max(found.stops_ms), "ms", at_most=STOP_AT_MOST_MS),
        figure(f"{name}: gateway grown", found.grown_mb, "MB", at_most=GROWN_AT_MOST_MB),
        figure(f"{name}: gateway at most", found.peak_mb, "MB"),
        figure(f"{name}: gateway's CPU of one core", found.cpu_percent, "%"),
        figure(f"{name}: frames sent", found.rate_hz, "Hz"),
    ]


ALL_FLOODS: Final = (*KINDS, MIXED)


CPU_AT_MOST: Final = 3.0
RESIDENT_AT_MOST_MB: Final = 60.0
SETTLES_BEFORE_COST_S: Final = 5.0


def cost_figures(options: argparse.Namespace) -> Figures:
    """Measure while the robot drives."""
    shares, sizes, rates, kb = [], [], [], []
    with on_air() as air, MavlinkClient(air.line()) as client:
        driver = Driver(client, air)
        driver.take()
        driver.drive(SETTLES_BEFORE_COST_S)
        for _ in range(options.repetitions):
            begun_s = cpu_s(air.pid)
            client.arrivals.clear()
            driver.drive(options.seconds)
            took_s = (client.arrivals[-1].at_ns - client.arrivals[0].at_ns) / NS_PER_S
            shares.append(100.0 * (cpu_s(air.pid) - begun_s) / took_s)
            sizes.append(resident_mb(air.pid))
            rates.append(len(client.arrivals) / took_s)
            kb.append(sum(one.size for one in client.arrivals) / took_s / 1e3)
    figures = [
        figure("CPU of one core", shares, "%", at_most=CPU_AT_MOST),
        figure("resident", sizes, "MB", at_most=RESIDENT_AT_MOST_MB),
        figure("messages to the client", rates, "Hz"),
        figure("bytes to the client", kb, "kB/s"),
    ]
    return figures, [f"cost: one robot that drives, one client; each reading {options.seconds:g} s"]


AT_MOST_KB_S: Final = 4.5
BAUD: Final = 57_600
LINE_SETTLES_S: Final = 3.0
AGAIN_S: Final = 4.0
"""The client asks for all parameters again after this time."""
GAP_AT_MOST_S: Final = {
    mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.5,
    mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: 0.6,
    mavlink.MAVLINK_MSG_ID_ATTITUDE: 0.6,
    mavlink.MAVLINK_MSG_ID_SYS_STATUS: 2.0,
}
"""The streams that a person watches, and the longest time without one of each."""


def line_figures(options: argparse.Namespace) -> Figures:
    """Measure over a serial line, and over UDP with `--low-rate`."""
    figures = []
    serial = PseudoLine()
    with on_air(endpoints=(f"serial:{serial.device}:{BAUD},accept",)) as air:
        figures += on_line("serial line", air, serial, options)
    with on_air("--low-rate") as air:
        figures += on_line("UDP, --low-rate", air, air.line(), options)
    return figures, [
        f"slow line: the robot drives; the client reads all parameters every {AGAIN_S:g} s; the"
        " serial line is a pseudo-terminal, which carries bytes faster than a line of 57,600 baud",
        "any second: the largest sum of all windows of one second",
    ]


def on_line(name: str, air: Air, line: Line, options: argparse.Namespace) -> list[Figure]:
    """Drive, read parameters repeatedly, and count the received bytes."""
    over = Event()
    with MavlinkClient(line) as client:
        driver = Driver(client, air)
        driver.take()
        reader = Thread(target=read_parameters, args=(client, over), daemon=True)
        reader.start()
        driver.drive(LINE_SETTLES_S)
        client.arrivals.clear()
        driver.drive(options.seconds)
        over.set()
        reader.join()
        arrivals = tuple(client.arrivals)
    return line_figures_of(name, arrivals)


def read_parameters(client: MavlinkClient, over: Event) -> None:
    """Ask for all parameters again and again."""
    while not over.wait(AGAIN_S):
        client.send(mavlink.MAVLink_param_request_list_message(1, 1))


def line_figures_of(name: str, arrivals: Sequence[FrameArrival]) -> list[Figure]:
    """Return the rates and the gaps of what has arrived."""
    seconds = (arrivals[-1].at_ns - arrivals[0].at_ns) / NS_PER_S
    mean_kb = sum(one.size for one in arrivals[1:]) / seconds / 1e3
    parameters = sum(one.number == mavlink.MAVLINK_MSG_ID_PARAM_VALUE for one in arrivals)
    found = [
        figure(f"{name}: mean", mean_kb, "kB/s", at_most=AT_MOST_KB_S),
        figure(f"{name}: any second", most_in_a_second(arrivals) / 1e3, "kB/s"),
        figure(f"{name}: parameters", parameters, at_least=1.0),
    ]
    for number, at_most_s in GAP_AT_MOST_S.items():
        times_ns = [one.at_ns for one in arrivals if one.number == number]
        gaps = tuple((b - a) / NS_PER_S for a, b in pairwise(times_ns)) or (float("inf"),)
        kind = mavlink.mavlink_map[number].msgname
        found += [
            figure(f"{name}: between {kind}", gaps, "s"),
            figure(f"{name}: between {kind}, longest", max(gaps), "s", at_most=at_most_s),
        ]
    return found


def most_in_a_second(arrivals: Sequence[FrameArrival]) -> int:
    """Return the largest number of bytes in a window of one second."""
    most = first = inside = 0
    for one in arrivals:
        inside += one.size
        while one.at_ns - arrivals[first].at_ns >= NS_PER_S:
            inside -= arrivals[first].size
            first += 1
        most = max(most, inside)
    return most


SILENCE_S: Final = 1.0
AT_ONCE: Final = 50
"""Missing parameters asked for at once, as by DroneKit."""
ITEMS: Final = 5
PATIENCE_S: Final = 60.0
APART_S: Final = 1.0
"""The gateway keeps a silent client for 10 s, and at most 16 of them."""
LOSSY: Final = Impairment(loss=0.2)
LINES: Final = (
    ("loopback", PERFECT, 2.0),
    ("20 % loss", LOSSY, 5.0),
    ("20 % loss, 50 ms, reordered", POOR, None),
)
FILE: Final = "@PARAM/param.pck?withdefaults=1"


class Newcomer:
    """A client that has to read everything."""

    def __init__(self, client: MavlinkClient) -> None:
        self._client = client
        self._files: SimpleQueue[MavMessage] = SimpleQueue()
        self._values: dict[int, float] = {}
        self._count = 0
        self._items: dict[int, MavMessage] = {}
        self.source_system, self.source_component = GROUND_STATION, 190
        self.mav = self
        client.takes = self._take

    def ready_s(self, *, by_file: bool) -> float:
        """Read everything at once; return the time since the first heartbeat was sent."""
        begun_s = monotonic()
        parameters = self._read_file if by_file else self._read_list
        with self._client, ThreadPoolExecutor(3) as pool:
            self._client.await_vehicle()
            jobs = [pool.submit(one) for one in (parameters, self._mission, self._home)]
            return max(job.result() for job in jobs) - begun_s

    def _read_list(self) -> float:
        """Return when all have come, as do the other readers."""

        def ask() -> None:
            if not self._count:
                self._client.send(mavlink.MAVLink_param_request_list_message(1, 1))
            missing = [one for one in range(self._count) if one not in self._values]
            for index in missing[:AT_ONCE]:
                self._client.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", index))

        repeat(ask, lambda: self._count and len(self._values) == self._count, self._progress)
        return monotonic()

    def _read_file(self) -> float:
        found: list[float] = []

        def keep(file: Any) -> None:
            if file is not None and mavftp.MAVFTP.ftp_param_decode(file.read()) is not None:
                found.append(monotonic())

        while not found:
            reader = mavftp.MAVFTP(self, 1, 1)
            reader.cmd_get([FILE], callback=keep)
            reader.process_ftp_reply("OpenFileRO", timeout=PATIENCE_S)
        return found[0]

    def _mission(self) -> float:
        def begin() -> None:
            self._client.send(mavlink.MAVLink_mission_request_list_message(1, 1))

        repeat(begin, lambda: "MISSION_COUNT" in self._client.newest)
        wanted = range(self._client.newest["MISSION_COUNT"].count)

        def ask() -> None:
            for number in wanted:
                if number not in self._items:
                    request = mavlink.MAVLink_mission_request_int_message(1, 1, number)
                    self._client.send(request)

        repeat(ask, lambda: len(self._items) == len(wanted), lambda: len(self._items))
        if len(wanted) != ITEMS + 1:
            raise RuntimeError(f"{len(wanted)} items instead of the home and {ITEMS}")
        self._client.send(mavlink.MAVLink_mission_ack_message(1, 1, 0))
        return monotonic()

    def _home(self) -> float:
        def ask() -> None:
            number = float(mavlink.MAVLINK_MSG_ID_HOME_POSITION)
            command = mavlink.MAV_CMD_REQUEST_MESSAGE
            rest = (number, *(0.0,) * 6)
            self._client.send(mavlink.MAVLink_command_long_message(1, 1, command, 0, *rest))

        repeat(ask, lambda: "HOME_POSITION" in self._client.newest)
        return monotonic()

    def _progress(self) -> int:
        return len(self._values)

    def _take(self, message: MavMessage) -> None:
        match message.get_type():
            case "PARAM_VALUE":
                self._count = message.param_count
                self._values[message.param_index] = message.param_value
            case "MISSION_ITEM_INT":
                self._items[message.seq] = message
            case "FILE_TRANSFER_PROTOCOL":
                self._files.put(message)

    def file_transfer_protocol_send(
        self, network: int, system: int, component: int, payload: bytes
    ) -> None:
        """Send a request of pymavlink's FTP client."""
        self._client.send(
            mavlink.MAVLink_file_transfer_protocol_message(
                network, system, component, list(payload)
            )
        )

    def recv_match(self, type: object = None, timeout: float = 0.0) -> MavMessage | None:
        """Return the next reply to pymavlink's FTP client."""
        with suppress(Empty):
            return self._files.get(timeout=timeout)
        return None


def repeat(
    ask: Callable[[], object],
    is_done: Callable[[], object],
    progress: Callable[[], int] = lambda: 0,
) -> None:
    """Ask, and again when nothing has come for a second, until it is done."""
    deadline_s, pause = monotonic() + PATIENCE_S, Event()
    asked_s, seen = 0.0, -1
    while not is_done():
        now_s = monotonic()
        if now_s > deadline_s:
            raise RuntimeError(f"not ready within {PATIENCE_S:g} s")
        if progress() != seen:
            asked_s, seen = (now_s if asked_s else 0.0), progress()
        if now_s - asked_s >= SILENCE_S:
            asked_s = now_s
            ask()
        pause.wait(0.002)


def ready_figures(options: argparse.Namespace) -> Figures:
    """Connect many times over each line, by each way to read parameters."""
    figures, pause = [], Event()
    with on_air() as air:
        with MavlinkClient(air.line()) as client:
            upload(client)
        for name, impairment, at_most_s in LINES:
            for way, by_file in (("FTP", True), ("list", False)):
                times = []
                for run in range(options.connections):
                    times.append(connected_s(air, impairment, run, by_file=by_file))
                    pause.wait(max(0.0, APART_S - times[-1]))
                title = f"ready, parameters by {way}, {name}"
                figures += [
                    figure(title, times, "s", at_most=at_most_s),
                    figure(f"{title}, worst", max(times), "s"),
                ]
    return figures, [
        f"ready: heartbeat, all parameters, a mission of {ITEMS} items, home;"
        f" {options.connections} new clients each; a request that is silent for {SILENCE_S:g} s is"
        " repeated; loss in each direction",
    ]


def connected_s(air: Air, impairment: Impairment, seed: int, *, by_file: bool) -> float:
    """Connect a new client over a line; return the time until it is ready."""
    with UdpRelay(("127.0.0.1", air.port), impairment, seed) as relay:
        return Newcomer(MavlinkClient(UdpLine(relay.port))).ready_s(by_file=by_file)


def upload(client: MavlinkClient) -> None:
    """Write a mission that the clients will read."""
    client.await_vehicle()
    until(lambda: "GLOBAL_POSITION_INT" in client.newest, "a position")
    place = client.newest["GLOBAL_POSITION_INT"]

    def answer(message: MavMessage) -> None:
        if message.get_type() in ("MISSION_REQUEST", "MISSION_REQUEST_INT"):
            frame, waypoint = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, 16
            client.send(
                mavlink.MAVLink_mission_item_int_message(
                    1, 1, message.seq, frame, waypoint, 0, 1, 0.0, 0.0, 0.0, 0.0,
                    place.lat, place.lon + 50 * message.seq, 0.0,
                )
            )  # fmt: skip

    client.takes = answer
    client.send(mavlink.MAVLink_mission_count_message(1, 1, ITEMS + 1))
    until(lambda: "MISSION_ACK" in client.newest, "MISSION_ACK")
    if client.newest["MISSION_ACK"].type != mavlink.MAV_MISSION_ACCEPTED:
        raise RuntimeError(f"no mission: {client.texts[-3:]}")


PARTS: Final = {
    "goto": reactions.goto_figures,
    "cost": cost_figures,
    "line": line_figures,
    "forgery": forgery.forgery_figures,
    "timeouts": reactions.timeout_figures,
    "ready": ready_figures,
    "flood": flood_figures,
}


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of this benchmark."""
    parser.add_argument("--parts", nargs="+", choices=list(PARTS), default=list(PARTS))
    parser.add_argument("--goals", type=int, default=200, help="of goto, by each way")
    parser.add_argument("--seconds", type=float, default=60.0, help="of each reading: cost, line")
    parser.add_argument("--repetitions", type=int, default=3, help="of the reading of the cost")
    parser.add_argument("--rounds", type=int, default=9, help="of all kinds of forgery")
    parser.add_argument("--forged", type=int, default=32, help="frames of each kind in a round")
    parser.add_argument("--stops", type=int, default=20, help="of each kind of setpoint")
    parser.add_argument("--connections", type=int, default=20, help="until ready, of each kind")
    parser.add_argument(
        "--kinds", nargs="+", choices=ALL_FLOODS, default=ALL_FLOODS, help="of flood"
    )
    parser.add_argument("--rate", type=float, default=10_000.0, help="frames a second of a flood")
    parser.add_argument("--drive", type=float, default=15.0, help="seconds of each flood")
    parser.add_argument("--presses", type=int, default=3, help="emergency stops in each flood")


def measure(options: argparse.Namespace) -> BenchmarkReport:
    """Measure the selected parts."""
    return BenchmarkReport.of("gateway", (PARTS[name](options) for name in options.parts))


if __name__ == "__main__":
    send_flood(sys.argv[1], float(sys.argv[2]), int(sys.argv[3]), int(sys.argv[4]))
