"""Measure whether each emergency stop reaches its robot while everything attacks at once.

The robot drives. Its plant and the operator that drives it dial the robot's own port; the app and
`estop` dial a router, which the robot dials too. So the wheels turn on when the router is killed.

Attacked, strangers call at both ports: 100 connections a second with garbage, 500 that are silent,
and 1000 forged stop datagrams a second. On a locked bus viewers declare hostile patterns at both.
For each press the session of an operator, in the app's rows the app's, is cut off and its id is
taken, on a locked bus by a viewer. In two of three presses the router is killed: before the key, or
at about the same time.
Without a link the router is dead in all presses, and the strangers call at the robot's port.

The time is that from the key in the terminal of the app, or from the start of the process of a
fresh `estop`, until the wheels stand by the plant's samples.
"""

import argparse
import json
import os
import signal
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from itertools import product
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from threading import Event, Thread, Timer
from typing import Any, Final

import zenoh

from checks.flood.attackers import DATAGRAMS, RATES_HZ, SOURCE, Access, Attack, Strangers
from checks.flood.under_attack import (
    FRESH_AT_MOST_MS,
    LOCKED,
    OPEN,
    OPERATOR_NAME,
    OPERATORS,
    DrivingOperator,
    StopTimes,
)
from checks.harness.figures import BenchmarkReport, Figure, figure
from checks.harness.observer import Observer, observed
from checks.harness.processes import free_port, made_keys, sidestep, tls_of
from checks.harness.relays import TcpProxy
from checks.harness.terminal import Terminal
from checks.harness.until import until
from protocol.bus.bus import open_bus
from protocol.bus.network import Network
from protocol.bus.session import configured
from protocol.topics import CYCLE, STATUS, Role
from protocol.wire.codec import decode
from protocol.wire.messages import CycleReport
from runtime.errors import LocalError

APP, ESTOP = "app", "estop"
ATTACKED, UNLINKED = "attacked", "no link"
STRANGERS: Final = ("garbage", "silent", DATAGRAMS)
AT_MOST_MS: Final = {APP: 300.0, ESTOP: FRESH_AT_MOST_MS}
BEGINS: Final = {APP: "key", ESTOP: "start of estop"}
PATTERNS: Final = "patterns"
VIEWER: Final = "viewer"

BEFORE, DURING, NEVER = "before the key", "about the key", "not"
"""When the router is killed."""

KEY: Final = " "
SIZE: Final = (100, 30)
HEARS: Final = "vgm_"
"""The app shows the navigator as soon as it receives the robot's status. A locked router passes on
nothing from the plant, so the app never finds all that it looks for."""

ACKNOWLEDGED: Final = ("acknowledged by", "acknowledged in")
PATIENCE_S: Final = 30.0
FAILURES: Final = (RuntimeError, LocalError)
WAITS_S: Final = 1.0
"""Longest wait between the loss of the session and the key; then its owner opens a fresh one."""

TURN_S: Final = 0.05


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of `bench stop_ways`."""
    parser.add_argument("--presses", type=int, default=100, metavar="N", help="of each row (100)")
    doors, ways, links = (OPEN, LOCKED), (APP, ESTOP), (ATTACKED, UNLINKED)
    parser.add_argument("--doors", nargs="+", choices=doors, default=doors, help="(both)")
    parser.add_argument("--ways", nargs="+", choices=ways, default=ways, help="(both)")
    parser.add_argument("--links", nargs="+", choices=links, default=links, help="(both)")
    parser.add_argument("--world", default="forest_medium")
    parser.add_argument("--seed", type=int, default=1, help="of the moments of the attacks (1)")


def measure(options: argparse.Namespace) -> BenchmarkReport:
    """Press the stop in each row of the table and report its figures."""
    figures: list[Figure] = []
    notes: list[str] = []
    with TemporaryDirectory(prefix="sidestep-stops-") as folder:
        keys = made_keys(Path(folder) / "keys", OPERATORS) if LOCKED in options.doors else None
        for door, link, way in product(options.doors, options.links, options.ways):
            name = f"{door}, {link}, {way}"
            print(f"{name} ...", file=sys.stderr, flush=True)
            with TemporaryDirectory(dir=folder) as place:
                row = run(options, Path(place), keys if door == LOCKED else None, link, way)
            found = list(figures_of(name, way, options.presses, row))
            met = "met" if all(one.met is not False for one in found) else "MISSED"
            print(f"  {len(row.presses)} presses: {met}", file=sys.stderr, flush=True)
            figures += found
            notes += notes_of(name, row)
    return BenchmarkReport(benchmark="stop_ways", figures=tuple(figures), notes=tuple(notes))


@dataclass(slots=True)
class StopRow:
    """The presses of a row, the robot's cycle reports and the reasons of other stops.

    `repeated` is why a press had to be repeated: there was none, or the robot stood already.
    """

    presses: list[StopTimes] = field(default_factory=list)
    reports: list[CycleReport] = field(default_factory=list)
    stopped: list[str] = field(default_factory=list)
    called: int = 0
    taken: int = 0
    killed: int = 0
    repeated: list[str] = field(default_factory=list)

    def repeat(self, why: str) -> None:
        """Note why a press has to be repeated."""
        print(f"  press {len(self.presses) + 1} again: {why}", file=sys.stderr, flush=True)
        self.repeated.append(why)

    def note(self, _key: str, frame: bytes, _arrived_ns: int) -> None:
        """Keep the first cycle report and the newest."""
        message = decode(frame).message
        if isinstance(message, CycleReport):
            self.reports = [*self.reports[:1], message]


class Router:
    """A router process that is killed and started again at the same endpoint."""

    def __init__(self, keys: Path | None) -> None:
        self.keys = keys
        self.endpoint = f"{'tls' if keys else 'tcp'}/127.0.0.1:{free_port()}"
        self.killed = 0
        self._scope = ExitStack()
        self._pid = 0

    def __enter__(self) -> "Router":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._scope.close()

    def start(self) -> None:
        """Start it, unless it runs."""
        if self._pid:
            return
        self._scope.close()
        locks = ("--config", str(self.keys / "router.toml")) if self.keys else ()
        words = ("run", "router", "--listen", self.endpoint, *locks)
        self._pid = self._scope.enter_context(sidestep(*words, ready="router at")).pid

    def kill(self) -> None:
        """Kill it."""
        os.kill(self._pid, signal.SIGKILL)
        self._pid = 0
        self.killed += 1


class TakenId:
    """Keeps taking a session id at an endpoint until the block ends; `calls` counts the tries."""

    def __init__(self, access: Access, zid: str) -> None:
        self.calls = 0
        self._access, self._zid = access, zid
        self._over = Event()
        self._thread = Thread(target=self._run, daemon=True)

    def __enter__(self) -> "TakenId":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()
        self._thread.join()

    def _run(self) -> None:
        config = configured(self._access.network(), WAITS_S)
        config.insert_json5("access_control", '{"enabled": false}')
        config.insert_json5("id", json.dumps(self._zid))
        place = f"{self._access.endpoint}#bind={SOURCE}:0"  # a door limits each address by itself
        config.insert_json5("connect/endpoints", json.dumps([place]))
        while not self._over.is_set():
            session: Any = None
            with suppress(zenoh.ZError):  # the router is dead, or another session has this id
                session = zenoh.open(config)
            self.calls += 1
            while not self._over.wait(TURN_S) and session and list(session.info.links()):
                pass
            if session:
                session.close()


@dataclass(slots=True, kw_only=True)
class AttackScene:
    """A robot that drives, the router that it dials, and the operator's files."""

    observer: Observer
    operator: DrivingOperator
    router: Router
    folder: Path
    random: Random

    @property
    def keys(self) -> Path | None:
        """The folder of the certificates; None on an open bus."""
        return self.router.keys

    @property
    def file(self) -> str:
        """The path of the operator's configuration; it names the address for stop datagrams."""
        return str(self.folder / "operator.toml")

    def access(self) -> Access:
        """Return the attacker's access to the router."""
        return Access(self.router.endpoint, self.keys, VIEWER if self.keys else "")


def run(
    options: argparse.Namespace, folder: Path, keys: Path | None, link: str, way: str
) -> StopRow:
    """Press the stop repeatedly by one way; return what was seen, also of a row that failed."""
    row = StopRow()
    try:
        with (
            driving(options, folder, keys) as scene,
            pressing(scene, row, link, way) as press,
            under_attack(scene, row, patterns=keys is not None and link == ATTACKED),
        ):
            scene.operator.set_off()
            scene.observer.bus.stream(CYCLE, row.note, scene.observer.robot)
            until(lambda: row.reports, "cycle reports")
            press_all(scene, row, press, options.presses)
            row.killed, row.stopped = scene.router.killed, scene.operator.stopped
    except FAILURES as error:
        row.repeat(str(error))
    return row


@contextmanager
def driving(options: argparse.Namespace, folder: Path, keys: Path | None) -> Iterator[AttackScene]:
    """Run a robot behind a router, and an operator that has its lease."""
    with (
        Router(keys) as router,
        observed(
            options.world, "--connect", router.endpoint, keys=keys, operator=OPERATOR_NAME
        ) as observer,
        DrivingOperator(observer) as operator,
    ):
        operator.take_lease()
        scene = AttackScene(
            observer=observer,
            operator=operator,
            router=router,
            folder=folder,
            random=Random(options.seed),
        )
        text = configuration(keys, observer.robot, observer.endpoint)
        Path(scene.file).write_text(text, encoding="utf-8")
        yield scene


@contextmanager
def under_attack(scene: AttackScene, row: StopRow, *, patterns: bool) -> Iterator[None]:
    """Let strangers call at robot and router, and viewers declare hostile patterns there."""
    endpoints = (scene.router.endpoint, scene.observer.endpoint)
    with ExitStack() as scope:
        strangers = [
            scope.enter_context(Strangers(endpoint, kind, RATES_HZ[kind], SOURCE))
            for endpoint in endpoints
            for kind in STRANGERS
        ]
        for endpoint in endpoints if patterns else ():
            scope.enter_context(Attack(PATTERNS, Access(endpoint, scene.keys, VIEWER))).go()
        yield
        row.called = sum(one.called for one in strangers)


def press_all(scene: AttackScene, row: StopRow, press: "Press", presses: int) -> None:
    """Press the stop so often at a robot that drives."""
    while len(row.presses) < presses and len(row.repeated) <= presses:
        try:
            times = press((BEFORE, DURING, NEVER)[len(row.presses) % 3])
        except FAILURES as error:  # no press yet, such as at a robot stuck at a tree
            row.repeat(str(error))
            continue
        if times.stood_ms == 0.0:
            row.repeat("the robot stood before the press")
        else:
            row.presses.append(times)


def configuration(keys: Path | None, robot: str, endpoint: str) -> str:
    """Return the operator's configuration file with the robot's address for stop datagrams."""
    text = f'robot = "{robot}"\n[network]\n'
    if keys:
        text = (keys / f"{OPERATOR_NAME}.toml").read_text(encoding="utf-8")
        for name in ("ca.pem", f"{OPERATOR_NAME}.pem", f"{OPERATOR_NAME}.key"):
            text = text.replace(f'"{name}"', f'"{keys / name}"')
    return f'{text}\n[network.stop_at]\n{robot} = "{endpoint.partition("/")[2]}"\n'


Press = Callable[[str], StopTimes]
"""One press; the word says when the router is killed."""


@contextmanager
def pressing(scene: AttackScene, row: StopRow, link: str, way: str) -> Iterator[Press]:
    """Yield what presses the stop once and clears it."""
    operator, router = scene.operator, scene.router

    def by_estop() -> StopTimes:
        words = ["--connect", router.endpoint, "--config", scene.file]
        return operator.press_freshly([*words, "--id", scene.observer.robot])

    def by_app(app: Terminal) -> StopTimes:
        app.forget()
        return operator.press_elsewhere(
            lambda: app.type(KEY), lambda: any(words in app.text() for words in ACKNOWLEDGED)
        )

    def attacked(killed: str) -> StopTimes:
        router.start()
        with TcpProxy(router.endpoint) as relay, ExitStack() as scope:
            if way == APP:
                app = scope.enter_context(app_at(scene, relay.endpoint))
                zid = operator_beside(scene.observer)
            else:
                zid = scope.enter_context(idle_session(scene, relay.endpoint))
            operator.set_off()
            relay.cut()
            relay.redirect(router.endpoint)  # ends the connection, and none is accepted
            taken = scope.enter_context(TakenId(scene.access(), zid))
            until(lambda: taken.calls, "a try to take the id", PATIENCE_S)
            relay.restore()
            operator.drive(scene.random.uniform(0.0, WAITS_S))
            if killed == BEFORE:
                router.kill()
            operator.set_off()
            timer = Timer(scene.random.uniform(0.0, AT_MOST_MS[way] / 2e3), router.kill)
            if killed == DURING:
                timer.start()
            times = by_app(app) if way == APP else by_estop()
            if killed == DURING:
                timer.join()
            row.taken += taken.calls
        return times

    def unlinked(_killed: str) -> StopTimes:
        operator.set_off()
        return by_app(app) if way == APP else by_estop()

    if link == ATTACKED:
        yield attacked
        return
    with ExitStack() as scope:
        if way == APP:
            app = scope.enter_context(app_at(scene, router.endpoint))
        router.kill()
        yield unlinked


@contextmanager
def app_at(scene: AttackScene, endpoint: str) -> Iterator[Terminal]:
    """Run the app until the block ends; it hears the robot."""
    words = ("ground", "--id", scene.observer.robot, "--connect", endpoint, "--config", scene.file)
    environment = {"XDG_STATE_HOME": str(scene.folder)}
    with Terminal((*words, "--no-record", "--quiet-bell"), SIZE, environment) as app:
        until(lambda: HEARS in app.text(), "the app hears the robot", PATIENCE_S)
        yield app


@contextmanager
def idle_session(scene: AttackScene, endpoint: str) -> Iterator[str]:
    """Open a session of the operator by the router; yield its id as soon as it hears the robot."""
    tls = tls_of(scene.keys, OPERATOR_NAME) if scene.keys else None
    network = Network(mode="client", connect=(endpoint,), tls=tls, connect_timeout_s=PATIENCE_S)
    with open_bus(network, Role.GROUND, scene.observer.robot) as bus:
        box = bus.mailbox(STATUS)
        until(box.latest, "a status by the router", PATIENCE_S)
        yield bus.zid


def operator_beside(observer: Observer) -> str:
    """Return the session id of another operator than the one that drives."""
    found: list[str] = []

    def is_there() -> bool:
        ids = (one.zid for one in observer.bus.present() if one.role == Role.GROUND.value)
        found.extend(zid for zid in ids if zid != observer.bus.zid)
        return bool(found)

    until(is_there, "another operator is announced", PATIENCE_S)
    return found[0]


def figures_of(name: str, way: str, wanted: int, row: StopRow) -> Iterator[Figure]:
    """Yield the figures of a row."""
    begins = BEGINS[way]
    stood_ms = [one.stood_ms for one in row.presses if one.stood_ms is not None]
    answered_ms = [one.acknowledged_ms for one in row.presses if one.acknowledged_ms is not None]
    if stood_ms:
        yield figure(f"{name}: {begins} to standstill", stood_ms, "ms")
        worst = f"{name}: {begins} to standstill, worst of {len(stood_ms)}"
        yield figure(worst, max(stood_ms), "ms", at_most=AT_MOST_MS[way])
    if answered_ms:
        acknowledged = f"{name}: {begins} to acknowledgement"
        yield figure(acknowledged, answered_ms, "ms")
    yield figure(f"{name}: not stopped, of {wanted}", wanted - len(stood_ms), at_most=0.0)
    yield figure(f"{name}: not acknowledged", wanted - len(answered_ms), at_most=0.0)
    false = sum(one.is_false_acknowledgement for one in row.presses)
    yield figure(f"{name}: false acknowledgements", false, at_most=0.0)
    yield figure(f"{name}: unexpected stops", len(row.stopped))
    if row.reports:
        first, last = row.reports[0], row.reports[-1]
        yield figure(
            f"{name}: ticks missed of {last.tick - first.tick}", last.missed - first.missed
        )


def notes_of(name: str, row: StopRow) -> Iterator[str]:
    """Yield what the attackers did, and why the robot stopped unexpectedly."""
    yield (
        f"{name}: {row.called} calls of strangers, {row.taken} tries to take an id, router killed"
        f" {row.killed} times"
    )
    if row.repeated:
        reasons = "; ".join(f"{n} x {why}" for why, n in Counter(row.repeated).items())
        yield f"{name}: {len(row.repeated)} presses repeated: {reasons}"
    for words in dict.fromkeys(row.stopped):
        yield f"{name}, stopped: {words}"
