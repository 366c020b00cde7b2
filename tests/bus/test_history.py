"""Late join: each event arrives once and in order, whatever is lost."""

import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from threading import Event
from types import SimpleNamespace
from typing import Final, Literal, cast

import pytest
import zenoh

from checks.harness.relays import TcpProxy
from checks.harness.until import PATIENCE_S, until
from ground.station.link.streams import StreamCounter
from ground.text.wording import aged
from protocol.bus.bus import Bus, open_bus
from protocol.bus.callbacks import zenoh_callback
from protocol.bus.network import Mode, Network
from protocol.bus.peers import declare_link_events
from protocol.bus.publisher import (
    FETCHED,
    FETCHES,
    LIVE,
    MAX_WAITING,
    SOURCES,
    Got,
    LateJoin,
    Source,
    fetch,
    source_in,
)
from protocol.topics import MARK, TEXT, TOPICS, WHEELS, Role
from protocol.wire.codec import decode
from protocol.wire.enums import Severity
from protocol.wire.messages import Statustext, WheelTicks
from tests.support.networks import TOPOLOGIES, Keyring, Topology, net, prefixes

CUT_S: Final = 3.0
"""Three times what it takes until a silent link is given up."""
EVERY_S: Final = 0.1
CUTS: Final = 7
"""At a time, in each of the three ways, so 21 in all."""
SLACK_NS: Final = 2_000_000
"""Between the clocks of UTC and of the bus: their difference is read at two times."""
LISTEN: Final = ("tcp/127.0.0.1:0",)
TICKS: Final = WheelTicks(time_ns=1, seq=1, left=2, right=-3, bumper=0, expired=0)

Way = Literal["hub", "router", "robot"]
"""Whose link is cut: the recorder's to the robot, the recorder's to a router, the robot's to it."""


def text(words: str) -> Statustext:
    return Statustext(severity=Severity.INFO, text=words, id=0, chunk_seq=0)


ATTEMPTS = 5


class Heard:
    """Collect the texts of events in order, and their age on arrival, as a recorder does."""

    def __init__(self, bus: Bus) -> None:
        self.words: list[str] = []
        self.ages_s: list[float] = []
        self.told_ns: list[int] = []
        self.others = 0
        self.counter = StreamCounter(TEXT)
        bus.stream_all(self._take)

    def _take(self, _key: str, frame: bytes, told_ns: int) -> None:
        message = decode(frame).message
        if isinstance(message, Statustext):
            self.words.append(message.text)
            self.ages_s.append((time.monotonic_ns() - told_ns) / 1e9)
            self.told_ns.append(told_ns)
            self.counter.take(frame, told_ns)
        else:
            self.others += 1


class Line:
    """A robot, a recorder, and a cable between them that can be cut."""

    def __init__(self, stack: ExitStack, way: Way) -> None:
        self._stack = stack
        self._prefix = next(prefixes)
        self._scope = stack.enter_context(ExitStack())
        self.told: list[str] = []
        if way == "hub":
            self.begin(Network(mode="peer", listen=LISTEN, prefix=self._prefix))
            self.cable = stack.enter_context(TcpProxy(self.robot.locator()))
            dialled = self.cable.endpoint
        else:
            router = Network(mode="router", listen=LISTEN, prefix=self._prefix)
            hub = stack.enter_context(open_bus(router, None, "r1")).locator()
            self.cable = stack.enter_context(TcpProxy(hub))
            robot, dialled = hub, self.cable.endpoint
            if way == "robot":
                robot, dialled = dialled, robot
            self.begin(self._dialling(robot))
        self._dialled = dialled
        self.recorder = self.join()
        self.heard = Heard(self.recorder)

    def begin(self, network: Network) -> None:
        """Start a robot, or replace one that was killed."""
        self._scope.close()
        self.network = network
        self.robot = self._scope.enter_context(open_bus(network, Role.ROBOT, "r1"))
        self._publisher = self.robot.publisher(TEXT)

    def join(self) -> Bus:
        """Return one more recorder."""
        return self._stack.enter_context(open_bus(self._dialling(self._dialled), None, "r1"))

    def tell(self, words: str) -> None:
        self.told.append(words)
        self._publisher.put(text(words))

    def whole(self) -> bool:
        return len(self.heard.words) >= len(self.told)

    def _dialling(self, endpoint: str) -> Network:
        return Network(mode="client", connect=(endpoint,), prefix=self._prefix)


@contextmanager
def lines(*ways: Way, count: int = CUTS) -> Iterator[list[Line]]:
    """Yield `count` lines of each way, which are cut at the same time."""
    with ExitStack() as stack:
        found = [Line(stack, way) for way in ways for _ in range(count)]
        tell(found, "started")
        until(lambda: all(line.whole() for line in found))
        yield found


def missing(found: Sequence[Line]) -> str:
    """Return which words each line lacks."""
    lacking = {
        number: [word for word in line.told if word not in line.heard.words]
        for number, line in enumerate(found)
    }
    return f"line number, words that are missing: {lacking}"


def tell(found: Sequence[Line], *words: str) -> None:
    pause = Event()
    for word in words:
        for line in found:
            line.tell(word)
        pause.wait(EVERY_S)


def cut(found: Sequence[Line], word: str, seconds: float = CUT_S) -> None:
    """Cut the links for `seconds` while the robots publish events."""
    for line in found:
        line.cable.cut()
    tell(found, *(f"{word} {number}" for number in range(round(seconds / EVERY_S))))
    for line in found:
        assert len(line.heard.words) < len(line.told), "it was not cut"


@pytest.mark.stack
def test_no_event_is_lost_or_doubled_over_a_cut() -> None:
    with lines("hub", "router", "robot") as found:
        cut(found, "during")
        for line in found:
            line.cable.restore()
        tell(found, *(f"after {number}" for number in range(5)))
        until(lambda: all(line.whole() for line in found), partial(missing, found))
        for line in found:
            assert line.heard.words == line.told
            assert line.heard.counter.lost == 0, "what came late counts as lost"
            assert max(line.heard.ages_s) > CUT_S / 2, "what is old looks new"


@pytest.mark.stack
def test_no_event_is_lost_or_doubled_by_a_fresh_session() -> None:
    with lines("robot", count=1) as (line,):
        sessions = vars(line.robot)["_sessions"]
        for life in range(3):
            line.tell(f"before {life}")
            until(line.whole)
            line.cable.cut()
            tell([line], *(f"during {life}.{number}" for number in range(20)))
            line.cable.restore()
            until(lambda: sessions.replace(sessions.now))
        line.tell("after")
        until(line.whole)
        assert line.heard.words == line.told
        assert line.heard.counter.lost == 0
        late = Heard(line.join())
        until(lambda: len(late.words) == len(line.told))
        assert sorted(late.words) == sorted(line.told), "who joins late hears them, too"
        assert max(late.ages_s) > 3.0


@pytest.mark.stack
@pytest.mark.parametrize("dropped", [False, True])
def test_link_given_up_while_it_opens_is_replaced(*, dropped: bool) -> None:
    """Keep Zenoh from reading a new link until it has given up, as a busy machine does.

    `dropped`: the other end drops that link, so the next one joins it.
    """
    with lines("hub", count=1) as (line,):
        for attempt in range(ATTEMPTS):
            if held_up(line, f"during {attempt}", dropped=dropped):
                break
        else:
            raise AssertionError("a fresh session came each time before Zenoh had dialled again")
        line.tell("after")
        until(line.whole, partial(missing, [line]))
        assert line.heard.words == line.told


def held_up(line: Line, word: str, *, dropped: bool) -> bool:
    """Cut and restore a line, and hold up its new link; return whether it got one to hold up."""
    cut([line], word)
    held = Event()

    def hold(event: zenoh.LinkEvent) -> None:
        if event.kind != zenoh.SampleKind.PUT or held.is_set():
            return
        held.set()
        before = line.cable.accepted
        until(lambda: line.cable.accepted > before, "Zenoh dials again")
        if dropped:
            line.cable.redirect(line.robot.locator())

    follower = declare_link_events(line.recorder._session, hold)
    line.cable.restore()
    until(line.whole, partial(missing, [line]))
    del follower
    return held.is_set()


@pytest.mark.stack
def test_log_lacks_only_events_of_a_robot_killed_in_a_cut() -> None:
    with lines("router") as found:
        cut(found, "before it was killed", EVERY_S)
        for line in found:
            del line.told[1:]
            line.begin(line.network)
        tell(found, *(f"anew {number}" for number in range(round(CUT_S / EVERY_S))))
        for line in found:
            line.cable.restore()
        until(lambda: all(line.whole() for line in found))
        for line in found:
            assert line.heard.words == line.told


@pytest.mark.stack
def test_events_of_a_restarted_robot_arrive_from_the_first() -> None:
    """Repeat 20 times in a row, without waiting for a match."""
    with lines("router", count=1) as (line,):
        for life in range(20):
            line.begin(line.network)
            for number in range(10):
                line.tell(f"{life}.{number}")
            until(line.whole)
        assert line.heard.words == line.told


@pytest.mark.stack
@pytest.mark.parametrize("topology", TOPOLOGIES)
def test_late_joiner_receives_newest_events_with_their_age(topology: Topology) -> None:
    with net(topology) as bus:
        publisher = bus.robot.publisher(TEXT)
        for number in range(TEXT.history + 5):
            publisher.put(text(f"{number}"))
        told_ns = time.monotonic_ns()
        heard = Heard(bus.join(None))
        until(lambda: len(heard.words) == TEXT.history)
        joined_ns = time.monotonic_ns()
        publisher.put(text("live"))
        until(lambda: heard.words[-1] == "live")
        assert heard.words == [f"{number}" for number in range(5, TEXT.history + 5)] + ["live"]
        assert max(heard.told_ns[:-1]) < told_ns + SLACK_NS
        assert heard.told_ns[-1] > joined_ns - SLACK_NS


@pytest.mark.stack
@pytest.mark.parametrize("listener", ["router", "robot-r1"])
def test_late_join_works_with_tls_for_allowed_roles(listener: str, tmp_path: Path) -> None:
    ring, prefix = Keyring(tmp_path), next(prefixes)

    def doors(name: str, connect: tuple[str, ...] = ()) -> Network:
        mode: Mode = "client" if connect else "router" if name == "router" else "peer"
        listen = () if connect else ("tls/127.0.0.1:0",)
        tls = ring.tls(name)
        return Network(
            mode=mode, listen=listen, connect=connect, prefix=prefix, robots=("r1",), tls=tls
        )

    with ExitStack() as stack:
        hub_role = None if listener == "router" else Role.ROBOT
        hub = open_bus(doors(listener), hub_role, "r1")
        stack.enter_context(hub)

        def join(name: str, role: Role | None) -> Bus:
            there = doors(name, (hub.locator(),))
            return stack.enter_context(open_bus(there, role, "r1"))

        robot = hub if hub_role else join("robot-r1", Role.ROBOT)
        publisher = robot.publisher(TEXT)
        mark = join("ground", Role.GROUND).publisher(MARK)
        publisher.put(text("started"))
        mark.put(text("a remark"))
        heard = Heard(join("viewer", None))
        until(lambda: len(heard.words) == 2)
        publisher.put(text("live"))
        until(lambda: heard.words[-1] == "live")
        assert sorted(heard.words) == ["a remark", "live", "started"]


@pytest.mark.stack
def test_streams_are_never_fetched_and_arrive_once() -> None:
    with net() as bus:
        wheels, events = bus.plant.publisher(WHEELS), bus.robot.publisher(TEXT)
        early = bus.robot.mailbox(WHEELS)
        until(lambda: wheels.matched)
        wheels.put(TICKS)
        until(early.latest)  # the hub has the sample: none is still in transit
        bus.robot.unsubscribe(early)
        until(lambda: not wheels.matched)
        heard = Heard(bus.ground)
        assert bus.plant.await_matched([wheels], PATIENCE_S) == []
        for _ in range(10):
            wheels.put(TICKS)
            events.put(text("event"))
        until(lambda: heard.others == 10 and len(heard.words) == 10)
        assert not any(topic.history for topic in TOPICS if topic.rate_hz)


@pytest.mark.stack
def test_sender_that_does_not_answer_is_asked_again() -> None:
    got: list[list[zenoh.Sample]] = []
    asked: list[None] = []
    key = f"{next(prefixes)}/text"

    def answer(query: zenoh.Query) -> None:
        asked.append(None)
        if len(asked) == 2:
            query.reply(query.key_expr, b"kept")

    with net() as bus:
        kept = bus.robot._session.declare_queryable(f"{key}/@adv/pub/a/7/_", zenoh_callback(answer))
        fetch(bus.ground._sessions, key, 9, A, 3, got.append)
        until(lambda: got)
        del kept
    ((found,),) = got
    assert found.payload.to_bytes() == b"kept"


@pytest.mark.stack
def test_fetch_ends_once_when_its_session_is_closed() -> None:
    got: list[list[zenoh.Sample]] = []
    with net() as bus:
        sessions = bus.ground._sessions
    fetch(sessions, "text", 9, A, 3, got.append)
    assert got == [[]]


@pytest.mark.stack
def test_only_old_events_show_their_age() -> None:
    ages_s = (0, 2, 12, 119, 130, 7300)
    assert [aged("x", age_s * 10**9) for age_s in ages_s] == [
        *("x", "x", "x (12 s ago)", "x (119 s ago)", "x (2 min ago)", "x (2 h ago)")
    ]


A = ("a", 7)


def sample(number: int, sender: str = "a", *, live: bool = True) -> zenoh.Sample:
    """Return a numbered sample of `sender`, either live or fetched."""
    info = SimpleNamespace(source_id=SimpleNamespace(zid=sender, eid=7), source_sn=number)
    how = LIVE if live else FETCHED
    return cast(zenoh.Sample, SimpleNamespace(source_info=info, congestion_control=how))


class Following:
    """A subscriber whose fetches are answered by `answer`, oldest first."""

    def __init__(self) -> None:
        self.heard: list[tuple[str, int]] = []
        self.asked: list[tuple[Source, int]] = []
        self._open: list[Got] = []
        self.late_join = LateJoin(self._fetch, self._take)

    def receive(self, *numbers: int, sender: str = "a") -> None:
        for number in numbers:
            self.late_join.receive(sample(number, sender))

    def answer(self, *numbers: int, sender: str = "a") -> None:
        self._open.pop(0)([sample(number, sender, live=False) for number in numbers])

    def _fetch(self, source: Source, due: int, got: Got) -> None:
        self.asked.append((source, due))
        self._open.append(got)

    def _take(self, found: zenoh.Sample) -> None:
        info = found.source_info
        assert info is not None
        self.heard.append((str(info.source_id.zid), info.source_sn))

    @property
    def numbers(self) -> list[int]:
        return [number for sender, number in self.heard if sender == "a"]


def test_fetched_samples_precede_the_first_live_sample() -> None:
    following = Following()
    following.receive(3, 4, 5)
    following.receive(0, sender="b")
    assert following.heard == [("b", 0)], "another sender does not wait"
    following.answer(4, 2, 0, 1, 3)
    following.receive(6)
    assert following.numbers == [0, 1, 2, 3, 4, 5, 6]
    assert following.asked == [(A, 0)]


def test_an_announced_sender_is_fetched_from_its_first_sample() -> None:
    following = Following()
    following.late_join.announced(A, 0)
    following.late_join.announced(A, 2)
    following.answer(0, 1, 2)
    following.late_join.announced(A, 2)
    assert following.numbers == [0, 1, 2]
    assert following.asked == [(A, 0)], "what has arrived is not fetched again"


def test_a_lost_newest_sample_is_fetched_when_announced() -> None:
    following = Following()
    following.receive(0, 1)
    following.late_join.announced(A, 3)
    following.answer(2, 3)
    following.receive(3, 4)
    assert following.numbers == [0, 1, 2, 3, 4]
    assert following.asked == [(A, 2)]


def test_a_sample_lost_during_a_fetch_is_fetched_too() -> None:
    following = Following()
    following.receive(2, 5)
    following.answer(0, 1, 2, 3)
    assert following.numbers == [0, 1, 2, 3]
    following.answer(4, 5)
    assert following.numbers == [0, 1, 2, 3, 4, 5]
    assert following.asked == [(A, 0), (A, 4)]


def test_samples_that_the_sender_no_longer_has_are_left_out() -> None:
    following = Following()
    following.receive(0, 900)
    following.answer(800, 801, 900)
    assert following.numbers == [0, 800, 801], "802 to 899 may come yet"
    following.answer()
    following.receive(901)
    assert following.numbers == [0, 800, 801, 900, 901]


def test_waiting_samples_are_delivered_without_an_answer() -> None:
    following = Following()
    following.receive(3, 7)
    following.answer()
    assert following.numbers == [3, 7]
    assert following.asked == [(A, 0)]


def test_an_answer_with_the_samples_of_another_sender_is_ignored() -> None:
    following = Following()
    following.receive(1)
    following.answer(0, sender="b")
    assert following.heard == [("a", 1)]


def test_complete_stream_is_not_fetched() -> None:
    following = Following()
    following.receive(0, 1, 1, 0, 2)
    assert following.numbers == [0, 1, 2]
    assert not following.asked


def test_invented_senders_use_bounded_fetches_and_memory() -> None:
    following = Following()
    for number in range(2 * SOURCES):
        following.receive(9, sender=str(number))
    assert len(following.heard) == 2 * SOURCES - FETCHES
    assert len(following.asked) == FETCHES
    assert len(following.late_join._senders) == SOURCES
    for number in range(FETCHES):
        following.answer(8, sender=str(number))
    assert len(following.heard) == 2 * SOURCES + FETCHES
    following.late_join.announced(("0", 7), 12)
    assert following.asked[-1] == (("0", 7), 10), "there is room for fetches again"


def test_few_samples_wait_for_an_answer() -> None:
    following = Following()
    following.receive(*range(1, 2 * MAX_WAITING))
    following.answer(0)
    assert following.numbers == list(range(MAX_WAITING + 1))


def test_foreign_samples_are_delivered_unchanged() -> None:
    heard: list[zenoh.Sample] = []
    foreign = cast(zenoh.Sample, SimpleNamespace(source_info=None, congestion_control=LIVE))
    late_join = LateJoin(lambda *_: None, heard.append)
    late_join.receive(foreign)
    late_join.receive(foreign)
    assert len(heard) == 2


def test_only_the_key_of_a_sender_names_one() -> None:
    named = partial("sidestep/r1/tlm/text/@adv/pub/{}/{}/_".format, "ab12")
    assert source_in(named(7)) == ("ab12", 7)
    assert source_in(named("uhlc")) is source_in(named("9" * 5000)) is None
