"""The lease: at most one holder, shown to all operators, and released when its holder is lost."""

import msgspec
from hypothesis import given
from hypothesis import strategies as st

from checks.harness.messages import make
from protocol.wire.enums import AckResult, Command, LeaseAction, MissionState, Mode, Severity
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    GoalRequest,
    LeaseRequest,
    LeaseStatus,
    MissionCount,
    MissionRequestList,
    MissionStatus,
    MissionVerdict,
    NavigatorStatus,
    ParamRequestRead,
    ParamSet,
    ParamValue,
    Teleop,
)
from protocol.wire.reasons import Reason
from protocol.wire.statustext import StatustextAssembler
from robot import telemetry
from robot.commands import NOTES
from robot.core import reasons, states
from robot.emergency_stop import emergency_stop
from robot.lease import IDLE_NS, LAPSE_NS, Lease
from runtime.units import NS_PER_S as S
from tests.support.each import each
from tests.support.robots import Desk, armed, goal, item, upload

ADA, ADAS_OTHER, ADAS_THIRD, BOB = "ada/1", "ada/2", "ada/3", "bob/0"
CRASHED = (Severity.WARNING, "lease of Ada lapsed: no heartbeat for 3 s")
IDLE = (Severity.INFO, "lease of Ada given back: nothing driven for 30 s")
RELEASED = (Severity.INFO, "Ada has released the lease")


def ask(action: int, name: str = "") -> LeaseRequest:
    return LeaseRequest(request_id=1, action=action, name=name)


def taken(now_ns: int = 0) -> Lease:
    lease = Lease()
    assert lease.receive(ask(LeaseAction.TAKE, "Ada"), ADA, now_ns) == Reason.NONE
    return lease


def kept() -> Lease:
    """Return a lease whose taking has been told."""
    lease = taken()
    lease.due(0)
    return lease


def shown(lease: Lease, now_ns: int, time_ns: int = 0) -> LeaseStatus:
    return lease.status(time_ns, now_ns, 0, "")


def test_without_a_holder_every_operator_may_command() -> None:
    lease = Lease()
    assert lease.allows(ADA)
    assert lease.allows("")
    assert shown(lease, 0, 7).held == 0
    assert shown(lease, 0, 7).holder == ""


def test_holder_commands_alone_and_is_named() -> None:
    lease = taken()
    assert lease.allows(ADA)
    assert not lease.allows(BOB)
    assert not lease.allows("")
    status = shown(lease, 1 * S, 7)
    assert (status.held, status.holder, status.name, status.lapses_ms) == (1, ADA, "Ada", 29_000)
    assert lease.due(0) == [(Severity.INFO, "Ada has taken the lease")]


def test_every_program_of_the_person_may_command() -> None:
    lease = taken()
    assert lease.allows(ADAS_OTHER)
    assert lease.is_holder(ADAS_OTHER)
    for other in (BOB, "adam/1", "ad/1", "/1", ""):
        assert not lease.allows(other)
        assert not lease.is_holder(other)


def test_other_operator_is_refused_until_the_release() -> None:
    lease = taken()
    for action in (LeaseAction.TAKE, LeaseAction.RELEASE, LeaseAction.LEAVE):
        assert lease.receive(ask(action), BOB, 0) == Reason.LEASE_HELD
    assert lease.receive(ask(LeaseAction.RELEASE), ADA, 0) == Reason.NONE
    assert lease.receive(ask(LeaseAction.TAKE), BOB, 0) == Reason.NONE
    assert lease.allows(BOB)


@each(
    ("action", "note"),
    [(LeaseAction.RELEASE, Reason.NO_LEASE), (LeaseAction.LEAVE, Reason.NONE)],
)
def test_release_without_a_holder_is_no_error(action: LeaseAction, note: Reason) -> None:
    lease, desk = Lease(), Desk()
    assert lease.receive(ask(action), BOB, 0) == note
    assert lease.due(0) == []
    answer = desk.vehicle.receive(ask(action), 0, BOB)
    assert isinstance(answer, CommandAck)
    assert answer.result == AckResult.ACCEPTED


def test_seizure_is_granted_with_a_critical_text() -> None:
    lease = kept()
    assert lease.receive(ask(LeaseAction.SEIZE, "Bob"), BOB, 0) == Reason.NONE
    assert lease.due(0) == [(Severity.CRITICAL, "LEASE SEIZED by Bob from Ada")]
    assert not lease.allows(ADA)


def test_taking_it_twice_only_changes_the_name() -> None:
    lease = kept()
    for action in (LeaseAction.TAKE, LeaseAction.SEIZE):
        assert lease.receive(ask(action, "Ada L."), ADAS_OTHER, 0) == Reason.NONE
        assert lease.due(0) == []
    status = shown(lease, 0)
    assert (status.name, status.holder) == ("Ada L.", ADAS_OTHER)


def test_any_program_of_the_person_releases_it() -> None:
    lease = kept()
    lease.beat(ADA, 1 * S)
    assert lease.receive(ask(LeaseAction.RELEASE, "other"), ADAS_OTHER, 1 * S) == Reason.NONE
    assert lease.due(1 * S) == [(Severity.INFO, "other has released the lease")]
    assert lease.allows(BOB)


# Its end without a release.


def test_it_lapses_three_seconds_after_the_last_heartbeat() -> None:
    lease = kept()
    lease.beat(ADA, 1 * S)
    assert lease.due(1 * S + LAPSE_NS) == []
    assert not lease.allows(BOB)
    assert lease.due(1 * S + LAPSE_NS + 1) == [CRASHED]
    assert lease.allows(BOB)
    assert lease.due(60 * S) == []


def test_the_newest_heartbeat_of_all_its_programs_counts() -> None:
    lease = kept()
    lease.beat(ADA, 2 * S)
    lease.beat(ADAS_OTHER, 1 * S)
    assert shown(lease, 2 * S).lapses_ms == 3_000
    lease.beat(ADAS_OTHER, 4 * S)
    assert shown(lease, 4 * S).lapses_ms == 3_000
    assert lease.due(2 * S + LAPSE_NS + 1) == []
    assert lease.due(4 * S + LAPSE_NS + 1) == [
        (Severity.WARNING, "lease of ada lapsed: no heartbeat for 3 s")
    ]


def test_heartbeats_of_others_keep_no_lease() -> None:
    lease = kept()
    lease.beat(ADA, 1 * S)
    lease.beat(BOB, 3 * S)
    assert lease.due(1 * S + LAPSE_NS + 1) == [CRASHED]


def test_without_any_heartbeat_there_are_thirty_seconds_to_begin() -> None:
    lease = taken(10 * S)
    lease.due(10 * S)
    assert shown(lease, 10 * S).lapses_ms == 30_000
    assert lease.due(10 * S + IDLE_NS) == []
    assert lease.is_holder(ADA)
    assert lease.due(10 * S + IDLE_NS + 1) == [IDLE]
    assert not lease.is_holder(ADA)


def test_heartbeats_from_before_the_grant_are_no_sign_of_a_crash() -> None:
    lease = Lease()
    lease.beat(ADA, 9 * S)
    lease.beat(ADAS_OTHER, 10 * S)
    lease.receive(ask(LeaseAction.TAKE, "Ada"), ADA, 10 * S)
    lease.due(10 * S)
    assert shown(lease, 10 * S).lapses_ms == 30_000
    assert lease.due(10 * S + IDLE_NS) == []
    assert lease.due(10 * S + IDLE_NS + 1) == [IDLE]


def test_an_idle_holder_gives_it_back_though_its_programs_are_there() -> None:
    lease = kept()
    lease.beat(ADA, IDLE_NS)
    assert shown(lease, IDLE_NS - 1 * S).lapses_ms == 1_000
    assert lease.due(IDLE_NS) == []
    assert lease.due(IDLE_NS + 1) == [IDLE]


def test_what_is_driven_keeps_it() -> None:
    lease = kept()
    lease.use(20 * S)
    lease.use(19 * S)
    assert shown(lease, 20 * S).lapses_ms == 30_000
    assert lease.due(20 * S + IDLE_NS) == []
    assert lease.due(20 * S + IDLE_NS + 1) == [IDLE]


def test_asking_for_it_again_keeps_it() -> None:
    lease = kept()
    lease.receive(ask(LeaseAction.TAKE, "Ada"), ADAS_OTHER, 20 * S)
    assert lease.due(20 * S + IDLE_NS) == []
    assert lease.due(20 * S + IDLE_NS + 1) == [IDLE]


def test_reordered_heartbeat_does_not_shorten_it() -> None:
    lease = taken()
    lease.beat(ADA, 2 * S)
    lease.beat(ADA, 1 * S)
    assert shown(lease, 2 * S).lapses_ms == 3_000
    assert lease.beaten_ns(ADA) == 2 * S


def test_an_ended_lease_shows_no_negative_time() -> None:
    assert shown(taken(), 31 * S).lapses_ms == 0


# A program that ends.


def test_the_last_program_that_leaves_releases_it() -> None:
    lease = kept()
    lease.beat(ADA, 1 * S)
    assert lease.receive(ask(LeaseAction.LEAVE, "Ada"), ADA, 1 * S) == Reason.NONE
    assert lease.due(1 * S) == [RELEASED]
    assert lease.beaten_ns(ADA) is None


@each(("since_ns", "stays"), [(0, True), (LAPSE_NS, True), (LAPSE_NS + 1, False)])
def test_a_program_leaves_it_to_others_that_are_there(since_ns: int, stays: bool) -> None:
    lease = kept()
    lease.beat(ADAS_OTHER, 1 * S)
    lease.beat(BOB, 1 * S + since_ns)
    lease.beat(ADA, 1 * S + since_ns)
    assert lease.receive(ask(LeaseAction.LEAVE, "Ada"), ADA, 1 * S + since_ns) == Reason.NONE
    assert lease.due(1 * S + since_ns) == ([] if stays else [RELEASED])
    assert lease.is_holder(ADA) == stays


def test_a_program_that_does_not_hold_it_leaves_it_to_the_holder() -> None:
    lease = kept()
    lease.beat(ADA, 1 * S)
    lease.beat(ADAS_OTHER, 1 * S)
    assert lease.receive(ask(LeaseAction.LEAVE), ADAS_OTHER, 1 * S) == Reason.NONE
    assert (lease.due(1 * S), shown(lease, 1 * S).holder) == ([], ADA)


def test_a_lease_that_is_left_to_a_silent_program_lapses_soon() -> None:
    """Though it was heard before the lease was granted: it may have been killed since."""
    lease = Lease()
    lease.beat(ADAS_OTHER, 1)
    lease.receive(ask(LeaseAction.TAKE, "Ada"), ADA, 2)
    lease.due(2)
    lease.receive(ask(LeaseAction.LEAVE), ADA, 2)
    assert lease.due(1 + LAPSE_NS) == []
    assert lease.is_holder(ADAS_OTHER)
    assert shown(lease, 1).lapses_ms == LAPSE_NS // 1_000_000
    (text,) = lease.due(2 + LAPSE_NS)
    assert "lapsed: no heartbeat" in text[1]


def test_a_program_that_never_sent_a_heartbeat_may_leave() -> None:
    lease = kept()
    assert lease.receive(ask(LeaseAction.LEAVE), ADAS_OTHER, 1 * S) == Reason.NONE
    assert lease.due(1 * S) == [(Severity.INFO, "ada has released the lease")]


def test_a_lease_is_shown_with_a_program_that_is_there() -> None:
    """One that has left, or was killed, is named no more: another of its person has the lease."""
    for is_killed in (False, True):
        lease = kept()
        lease.receive(ask(LeaseAction.TAKE, "shell"), ADAS_OTHER, 0)
        lease.beat(ADA, 1 * S)
        lease.beat(ADAS_OTHER, 1 * S)
        now_ns = 1 * S + 1
        if is_killed:
            lease.beat(ADA, 1 * S + LAPSE_NS)
            lease.due(1 * S + LAPSE_NS)
            assert shown(lease, now_ns).name == "shell"
            now_ns += LAPSE_NS
        else:
            lease.receive(ask(LeaseAction.LEAVE, "shell"), ADAS_OTHER, now_ns)
        assert lease.due(now_ns) == []
        status = shown(lease, now_ns)
        assert (status.held, status.holder, status.name) == (1, ADA, "Ada")


def test_a_heartbeat_that_arrives_after_its_program_has_left_is_late() -> None:
    lease = kept()
    lease.receive(ask(LeaseAction.LEAVE, "Ada"), ADA, 2 * S)
    lease.beat(ADA, 2 * S - 1)
    lease.receive(ask(LeaseAction.TAKE, "shell"), ADAS_OTHER, 3 * S)
    lease.receive(ask(LeaseAction.LEAVE, "shell"), ADAS_OTHER, 3 * S)
    assert lease.holder is None, "no program is there"
    lease.beat(ADA, 3 * S)
    assert lease.beaten_ns(ADA) == 3 * S, "it has come back"


def test_a_holder_without_a_heartbeat_has_time_to_send_one() -> None:
    lease = taken()
    lease.beat(ADAS_OTHER, 1 * S)
    lease.receive(ask(LeaseAction.TAKE, "shell"), ADAS_THIRD, 2 * S)
    lease.beat(ADAS_OTHER, 5 * S)
    lease.due(2 * S + LAPSE_NS)
    assert shown(lease, 5 * S).name == "shell"
    lease.due(2 * S + LAPSE_NS + 1)
    assert (shown(lease, 5 * S).holder, shown(lease, 5 * S).name) == (ADAS_OTHER, "")


# Programs.


def test_heartbeats_are_kept_by_program() -> None:
    lease = Lease()
    assert lease.beaten_ns(ADA) is None
    assert lease.beaten_ns("") is None
    lease.beat(ADA, 1 * S)
    lease.beat(BOB, 2 * S)
    assert (lease.beaten_ns(ADA), lease.beaten_ns(BOB)) == (1 * S, 2 * S)
    assert lease.beaten_ns("") == 2 * S
    lease.receive(ask(LeaseAction.TAKE, "Ada"), ADA, 2 * S)
    assert lease.beaten_ns("") == 1 * S, "of those that may command"


def test_who_takes_over_inherits_a_heartbeat_but_no_younger_one() -> None:
    lease = Lease()
    lease.inherit(BOB, ADA)
    assert lease.beaten_ns(BOB) is None
    lease.beat(ADA, 2 * S)
    lease.inherit(BOB, ADA)
    assert lease.beaten_ns(BOB) == 2 * S
    lease.beat(BOB, 3 * S)
    lease.inherit(BOB, ADA)
    assert lease.beaten_ns(BOB) == 3 * S


def test_the_programs_heard_last_are_kept() -> None:
    lease = Lease()
    for number in range(64):
        lease.beat(f"p/{number}", number)
    lease.beat("p/0", 0)
    assert lease.beaten_ns("p/1") == 1
    lease.beat(ADA, 0)
    assert lease.beaten_ns("p/1") is None
    assert lease.beaten_ns("p/0") == 0
    assert lease.beaten_ns("p/2") == 2


def test_the_drive_is_shown_with_the_name_of_its_program() -> None:
    lease = taken()
    status = shown(lease, 0)
    assert (status.drive_id, status.driver) == (0, "")
    status = lease.status(0, 0, 7, "pts/1")
    assert (status.drive_id, status.driver) == (7, "pts/1")


def test_free_lease_has_no_time_and_no_name() -> None:
    for lease in (Lease(), taken()):
        lease.receive(ask(LeaseAction.RELEASE), ADA, 1 * S)
        status = shown(lease, 1 * S, 7)
        assert (status.time_ns, status.held, status.lapses_ms) == (7, 0, 0)
        assert (status.holder, status.name) == ("", "")
        assert lease.holder is None
        assert not lease.is_holder(ADA)
        assert not lease.is_holder("")


def test_release_is_announced() -> None:
    lease = kept()
    lease.receive(ask(LeaseAction.RELEASE, "Ada"), ADA, 0)
    assert lease.due(0) == [RELEASED]
    lease.receive(ask(LeaseAction.RELEASE, "Ada"), ADA, 0)
    assert lease.due(0) == []


def test_sender_without_identity_cannot_hold_it() -> None:
    for action in LeaseAction:
        assert Lease().receive(ask(action), "", 0) == Reason.NO_OPERATOR


def test_control_characters_of_a_name_are_replaced() -> None:
    lease = Lease()
    lease.receive(ask(LeaseAction.TAKE, "A\x1b[2J\r\u202eb"), ADA, 0)
    assert shown(lease, 0).name == "A?[2J??b"
    assert lease.due(0)[0][1] == "A?[2J??b has taken the lease"


def test_an_unknown_action_is_refused() -> None:
    assert Lease().receive(ask(9), ADA, 0) == Reason.UNKNOWN_COMMAND
    assert taken().receive(ask(9), ADA, 0) == Reason.UNKNOWN_COMMAND


def test_unnamed_operator_is_shown_by_its_person() -> None:
    lease = Lease()
    lease.receive(ask(LeaseAction.TAKE), "ada-0123abcd/0123456789abcdef", 0)
    assert lease.due(0)[0][1] == "ada has taken the lease", "without the digits of an open bus"


steps = st.lists(
    st.tuples(
        st.sampled_from([*LeaseAction, None, 9]),
        st.sampled_from([ADA, ADAS_OTHER, BOB, ""]),
        st.sampled_from([0, 1, 1 * S, 2 * S, LAPSE_NS, LAPSE_NS + 1, 31 * S]),
    ),
    max_size=40,
)


@given(steps)
def test_any_order_of_requests_leaves_one_person_at_most(
    asked: list[tuple[int | None, str, int]],
) -> None:
    """Compare with the rules, written independently; None is a heartbeat of a program."""
    lease, person, granted_ns, used_ns, now_ns = Lease(), "", 0, 0, 0
    beats_ns: dict[str, int] = {}

    def newest_ns() -> int:
        return max((ns for one, ns in beats_ns.items() if one[:3] == person), default=-S * S)

    for action, operator, later_ns in asked:
        now_ns += later_ns
        lease.due(now_ns)
        if person and (
            now_ns - used_ns > IDLE_NS or (granted_ns < newest_ns() < now_ns - LAPSE_NS)
        ):
            person = ""
        mine = bool(operator) and person in ("", operator[:3])
        if action is None:
            if mine:
                lease.beat(operator, now_ns)
                beats_ns[operator] = now_ns
            continue
        why = lease.receive(ask(action), operator, now_ns)
        granted = why in (Reason.NONE, Reason.NO_LEASE)
        assert (why == Reason.NO_LEASE) == (action == LeaseAction.RELEASE and mine and not person)
        if action == LeaseAction.SEIZE:
            assert granted == bool(operator)
        else:
            assert granted == (mine and action != 9)
        if granted and action in (LeaseAction.TAKE, LeaseAction.SEIZE):
            person, granted_ns, used_ns = operator[:3], now_ns, now_ns
        elif granted:
            if action == LeaseAction.LEAVE:
                beats_ns.pop(operator, None)
            if action == LeaseAction.RELEASE or newest_ns() < now_ns - LAPSE_NS:
                person = ""
            elif action == LeaseAction.LEAVE:
                granted_ns = 0
        allowed = [who for who in (ADA, ADAS_OTHER, BOB) if lease.allows(who)]
        assert allowed == [one for one in (ADA, ADAS_OTHER, BOB) if person in ("", one[:3])]
        assert shown(lease, now_ns).held == bool(person)


# The lease at the vehicle.


def leased() -> Desk:
    """Return an armed robot whose lease Ada holds."""
    desk = armed()
    assert reason(desk, ask(LeaseAction.TAKE, "Ada"), ADA) == Reason.NONE
    return desk


NAMES = {ADA: "Ada", BOB: "Bob"}
"""The names under which the programs ask that have one."""


def reason(desk: Desk, request: Message, operator: str) -> int:
    if isinstance(request, CommandRequest | GoalRequest) and not request.sender:
        request = msgspec.structs.replace(request, sender=NAMES.get(operator, ""))
    answer = desk.vehicle.receive(request, desk.now_ns, operator)
    if isinstance(answer, MissionVerdict):
        return answer.reason
    assert isinstance(answer, CommandAck)
    is_accepted = answer.result_param2 in (Reason.NONE, *NOTES)
    assert (answer.result == AckResult.ACCEPTED) == is_accepted
    return answer.result_param2


def command(number: int, param1: float = 0.0) -> CommandRequest:
    number_of_request = number * 10 + int(param1)
    return CommandRequest(request_id=number_of_request, command=number, param1=param1, param2=0.0)


def manual() -> CommandRequest:
    mode = float(Mode.MANUAL)
    return CommandRequest(request_id=99, command=Command.DO_SET_MODE, param1=1.0, param2=mode)


@each(
    "request_of_other",
    [
        command(Command.COMPONENT_ARM_DISARM, 1.0),
        command(Command.SIDESTEP_SET_NAVIGATOR, 1.0),
        command(Command.SIDESTEP_CLEAR_EMERGENCY_STOP),
        goal(4, 1.0, 0.0),
        ParamSet(param_id="d_obs_m", param_value=0.4, param_type=9),
        MissionCount(count=1),
    ],
)
def test_requests_of_others_are_refused(
    request_of_other: Message,
) -> None:
    desk = leased()
    assert reason(desk, request_of_other, BOB) == Reason.LEASE_HELD
    assert reason(desk, request_of_other, "") == Reason.LEASE_HELD
    answer = desk.vehicle.receive(request_of_other, desk.now_ns, ADA)
    assert not isinstance(answer, CommandAck) or answer.result == AckResult.ACCEPTED


def test_emergency_stop_needs_no_lease() -> None:
    for operator in (BOB, ""):
        desk = leased()
        assert reason(desk, command(Command.DO_FLIGHTTERMINATION), operator) == Reason.NONE
        assert reason(desk, command(Command.SIDESTEP_CLEAR_EMERGENCY_STOP), BOB) == (
            Reason.LEASE_HELD
        )


@each(
    "request_of_other",
    [
        command(Command.DO_PAUSE_CONTINUE),
        command(Command.SIDESTEP_ABORT_GOAL),
        command(Command.COMPONENT_ARM_DISARM),
        CommandRequest(
            request_id=3, command=Command.DO_SET_MODE, param1=1.0, param2=float(Mode.HOLD)
        ),
    ],
)
def test_what_stops_the_robot_needs_no_lease(request_of_other: CommandRequest) -> None:
    for operator in (BOB, ""):
        desk = leased()
        assert reason(desk, goal(4, 3.0, 0.0), ADA) == Reason.NONE
        assert desk.step().left_mrad_s > 0
        assert reason(desk, request_of_other, operator) == Reason.NONE
        for _ in range(40):
            outputs = desk.step()
        assert (outputs.left_mrad_s, outputs.right_mrad_s) == (0, 0)


def test_reading_needs_no_lease() -> None:
    desk = leased()
    read = desk.vehicle.receive(ParamRequestRead(param_id="d_obs_m", param_index=-1), 0, BOB)
    assert isinstance(read, ParamValue)
    assert desk.vehicle.receive(MissionRequestList(), 0, BOB) == MissionCount(count=0)


def test_refused_request_is_checked_again_when_repeated() -> None:
    desk = leased()
    arm = command(Command.COMPONENT_ARM_DISARM, 1.0)
    assert reason(desk, arm, BOB) == Reason.LEASE_HELD
    reason(desk, ask(LeaseAction.RELEASE), ADA)
    assert reason(desk, arm, BOB) == Reason.NOTHING_CHANGED


def steer(desk: Desk, operator: str, speed_mm_s: int = 200) -> bool:
    """Send a teleop frame and return whether it counts."""
    frame = Teleop(time_ns=desk.now_ns, seq=0, speed_mm_s=speed_mm_s, yaw_rate_mrad_s=0, ttl_ms=500)
    desk.vehicle.receive_teleop(frame, desk.now_ns, operator)
    return desk.vehicle.teleop.newest(desk.now_ns) == frame


def beaten(desk: Desk, *operators: str) -> None:
    """Let these programs send a heartbeat, and a period pass."""
    for operator in operators:
        desk.vehicle.lease.beat(operator, desk.now_ns)
    desk.step()


def by_hand() -> Desk:
    """Return an armed robot that Ada drives by hand, with the lease."""
    desk = leased()
    beaten(desk, ADA)
    assert reason(desk, manual(), ADA) == Reason.NONE
    assert steer(desk, ADA)
    return desk


def test_losing_the_lease_ends_teleop() -> None:
    desk = by_hand()
    reason(desk, ask(LeaseAction.SEIZE, "Bob"), BOB)
    assert desk.vehicle.teleop.newest(desk.now_ns) is None
    reason(desk, ask(LeaseAction.RELEASE), BOB)
    assert desk.vehicle.teleop.newest(desk.now_ns) is None


def test_another_program_of_the_person_does_not_end_teleop() -> None:
    desk = by_hand()
    reason(desk, ask(LeaseAction.TAKE, "Ada"), ADAS_OTHER)
    assert desk.vehicle.teleop.newest(desk.now_ns) is not None


def test_lease_status_is_published_twice_a_second_and_on_change() -> None:
    desk = Desk()
    published = []
    for _ in range(41):
        desk.step()
        published.append(desk.vehicle.lease_status(desk.now_ns, desk.now_ns) is not None)
    assert sum(published) == 5
    desk.vehicle.receive(ask(LeaseAction.TAKE, "Ada"), desk.now_ns, ADA)
    status = desk.vehicle.lease_status(desk.now_ns, desk.now_ns)
    assert status is not None
    assert status.name == "Ada"
    assert "Ada has taken the lease" in [text.text for text in desk.vehicle.texts()]


def test_lapsed_lease_is_announced() -> None:
    desk = leased()
    pass_s(desk, 0.1, ADA)
    pass_s(desk, 3.2)
    assert CRASHED[1] in published(desk)
    assert desk.vehicle.lease.allows(BOB)


# The driver: the program that has the robot move.


def pass_s(desk: Desk, duration_s: float, *present: str) -> None:
    """Let time pass with the heartbeats of these programs."""
    for _ in range(round(duration_s * 20)):
        beaten(desk, *present)
        desk.vehicle.lease_status(desk.now_ns, desk.now_ns)


def published(desk: Desk) -> str:
    return "".join(text.text for text in desk.vehicle.texts())


def guided(operator: str, number: int = 4) -> tuple[GoalRequest, str]:
    return goal(number, 20.0, 0.0, Mode.GUIDED), operator


def lost(desk: Desk) -> bool:
    machine = desk.vehicle.state.machine
    return machine.vehicle == states.FAILSAFE and machine.vehicle_reason == Reason.OPERATOR_LOST


@each("begins", [goal(4, 20.0, 0.0, Mode.GUIDED), manual()])
def test_a_drive_ends_without_its_program_whoever_else_is_there(begins: Message) -> None:
    desk = leased()
    beaten(desk, ADA, ADAS_OTHER)
    assert reason(desk, begins, ADA) == Reason.NONE
    pass_s(desk, 2.0, ADA)
    assert not lost(desk)
    pass_s(desk, 1.4, ADAS_OTHER)
    assert not lost(desk)
    pass_s(desk, 0.3, ADAS_OTHER)
    assert lost(desk)


def test_what_nobody_needs_to_watch_goes_on_without_its_program() -> None:
    desk = leased()
    beaten(desk, ADA)
    assert reason(desk, goal(4, 20.0, 0.0), ADA) == Reason.NONE
    pass_s(desk, 4.0, ADAS_OTHER)
    assert desk.vehicle.state.machine.vehicle == states.ACTIVE
    assert desk.vehicle.state.machine.operator


@each("begins", [goal(4, 20.0, 0.0, Mode.GUIDED), manual(), "resume"])
def test_who_sends_no_heartbeat_begins_no_drive_that_needs_one(begins: Message | str) -> None:
    desk = leased()
    beaten(desk, ADA)
    if isinstance(begins, str):
        assert reason(desk, *guided(ADA)) == Reason.NONE
        assert reason(desk, command(Command.DO_PAUSE_CONTINUE), ADA) == Reason.NONE
        pass_s(desk, 2.0)  # who began the drive is gone
        pass_s(desk, 0.1, ADAS_THIRD)
        begins = command(Command.DO_PAUSE_CONTINUE, 1.0)
    before = desk.vehicle.state.machine.mode
    assert reason(desk, begins, ADAS_OTHER) == Reason.NO_OPERATOR
    assert desk.vehicle.state.machine.mode == before
    desk.vehicle.lease.beat(ADAS_OTHER, desk.now_ns)
    desk.step()
    again = msgspec.structs.replace(begins, request_id=77)
    assert reason(desk, again, ADAS_OTHER) == Reason.NONE
    assert desk.vehicle.commands.driver == ADAS_OTHER


def test_a_resumed_drive_keeps_the_program_that_began_it() -> None:
    desk = leased()
    beaten(desk, ADA)
    assert reason(desk, *guided(ADA)) == Reason.NONE
    assert reason(desk, command(Command.DO_PAUSE_CONTINUE), BOB) == Reason.NONE
    resume = command(Command.DO_PAUSE_CONTINUE, 1.0)
    assert reason(desk, resume, ADAS_OTHER) == Reason.NONE, "it sends no heartbeat and needs none"
    assert (desk.vehicle.commands.driver, desk.vehicle.commands.drive_id) == (ADA, 4)
    pass_s(desk, 2.0, ADA)
    assert not lost(desk)
    pass_s(desk, 2.0, ADAS_OTHER)
    assert lost(desk)


def test_who_resumes_after_the_program_that_began_it_is_the_driver() -> None:
    desk = leased()
    beaten(desk, ADA)
    assert reason(desk, *guided(ADA)) == Reason.NONE
    assert reason(desk, command(Command.DO_PAUSE_CONTINUE), ADA) == Reason.NONE
    pass_s(desk, 2.0, ADAS_OTHER)
    assert reason(desk, command(Command.DO_PAUSE_CONTINUE, 1.0), ADAS_OTHER) == Reason.NONE
    assert desk.vehicle.commands.drive_id == 4, "it is still the same goal"
    pass_s(desk, 2.0, ADAS_OTHER)
    assert not lost(desk)
    pass_s(desk, 2.0, ADA)
    assert lost(desk)


def held_by_ada() -> Desk:
    """Return a robot without a lease whose goal Ada has begun and held; Bob is there, too."""
    desk = armed()
    beaten(desk, ADA, BOB)
    assert reason(desk, *guided(ADA)) == Reason.NONE
    assert reason(desk, command(Command.DO_PAUSE_CONTINUE), ADA) == Reason.NONE
    return desk


def test_another_person_who_resumes_is_the_driver() -> None:
    desk = held_by_ada()
    assert reason(desk, command(Command.DO_PAUSE_CONTINUE, 1.0), BOB) == Reason.NONE
    assert (desk.vehicle.commands.driver, desk.vehicle.commands.drive_id) == (BOB, 4)
    pass_s(desk, 2.0, BOB)
    assert not lost(desk)
    pass_s(desk, 2.0, ADA)
    assert lost(desk)


def test_another_person_without_a_heartbeat_resumes_nothing() -> None:
    desk = held_by_ada()
    pass_s(desk, 2.0, ADA)
    assert reason(desk, command(Command.DO_PAUSE_CONTINUE, 1.0), BOB) == Reason.NO_OPERATOR
    assert desk.vehicle.commands.driver == ADA
    assert desk.vehicle.state.machine.mode == states.HOLD


@each("resumer", [ADA, BOB])
def test_jump_to_another_item_keeps_the_driver(resumer: str) -> None:
    """A jump leads the mission on, of which the program that began it goes on to be asked."""
    desk = armed()
    upload(desk, [item(0, 3.0, 0.0), item(1, 6.0, 0.0)])
    assert reason(desk, command(Command.MISSION_START), ADA) == Reason.NONE
    jump = command(Command.DO_SET_MISSION_CURRENT, 1.0)
    assert reason(desk, jump, resumer) == Reason.NONE
    assert desk.vehicle.commands.driver == ADA


def test_asking_to_continue_what_goes_on_changes_no_driver() -> None:
    desk = leased()
    beaten(desk, ADA, ADAS_OTHER)
    assert reason(desk, *guided(ADA)) == Reason.NONE
    assert reason(desk, command(Command.DO_PAUSE_CONTINUE, 1.0), ADAS_OTHER) == Reason.NONE
    assert desk.vehicle.commands.driver == ADA


def test_a_refused_or_repeated_request_changes_no_driver() -> None:
    desk = leased()
    beaten(desk, ADA, ADAS_OTHER)
    assert reason(desk, *guided(ADA, 4)) == Reason.NONE
    assert reason(desk, goal(5, 1e4, 0.0, Mode.GUIDED), ADAS_OTHER) != Reason.NONE
    assert desk.vehicle.commands.driver == ADA
    assert reason(desk, *guided(ADAS_OTHER, 6)) == Reason.NONE
    assert reason(desk, *guided(ADA, 4)) == Reason.NONE
    assert (desk.vehicle.commands.driver, desk.vehicle.commands.drive_id) == (ADAS_OTHER, 6)


def test_after_a_drive_in_guided_any_program_is_an_operator() -> None:
    desk = leased()
    beaten(desk, ADA)
    assert reason(desk, *guided(ADA)) == Reason.NONE
    assert reason(desk, command(Command.SIDESTEP_ABORT_GOAL), ADA) == Reason.NONE
    pass_s(desk, 4.0, ADAS_OTHER)
    assert desk.vehicle.state.machine.operator
    assert reason(desk, *guided(ADAS_OTHER, 5)) == Reason.NONE


def test_after_the_loss_of_its_driver_another_program_takes_over() -> None:
    desk = by_hand()
    pass_s(desk, 2.0, ADAS_OTHER)
    assert lost(desk)
    pass_s(desk, 0.1, ADAS_OTHER)
    assert reason(desk, command(Command.COMPONENT_ARM_DISARM, 1.0), ADAS_OTHER) == Reason.NONE
    pass_s(desk, 1.0, ADAS_OTHER)
    assert desk.vehicle.state.machine.vehicle == states.ACTIVE
    assert steer(desk, ADAS_OTHER)


def test_only_the_driver_steers() -> None:
    desk = by_hand()
    assert not steer(desk, ADAS_OTHER, 300)
    beaten(desk, ADA, ADAS_OTHER)
    again = CommandRequest(
        request_id=100, command=Command.DO_SET_MODE, param1=1.0, param2=float(Mode.MANUAL)
    )
    assert reason(desk, again, ADAS_OTHER) == Reason.NONE
    assert desk.vehicle.teleop.newest(desk.now_ns) is None, "frames of the former driver end"
    assert steer(desk, ADAS_OTHER, 300)
    assert not steer(desk, ADA)


def test_who_seizes_the_lease_takes_over_the_drive() -> None:
    desk = by_hand()
    reason(desk, ask(LeaseAction.SEIZE, "Bob"), BOB)
    assert desk.vehicle.commands.driver == BOB
    pass_s(desk, 1.3)
    assert not lost(desk), "the last heartbeat of the former driver counts"
    pass_s(desk, 1.0, BOB)
    assert not lost(desk)
    assert steer(desk, BOB)
    pass_s(desk, 1.7)
    assert lost(desk)


def test_a_seizure_without_a_heartbeat_ends_the_drive() -> None:
    desk = by_hand()
    reason(desk, ask(LeaseAction.SEIZE, "Bob"), BOB)
    pass_s(desk, 1.7)
    assert lost(desk)


@each("held", [False, True])
@each("killed_s", [0.7, 1.4])
def test_a_killed_program_leads_no_drive_that_is_resumed(held: bool, killed_s: float) -> None:
    """Its last heartbeat is younger than the time after which the robot stops."""
    desk = leased()
    beaten(desk, ADA)
    assert reason(desk, *guided(ADA)) == Reason.NONE
    if held:
        assert reason(desk, command(Command.DO_PAUSE_CONTINUE), ADA) == Reason.NONE
    pass_s(desk, killed_s)
    resume = command(Command.DO_PAUSE_CONTINUE, 1.0)
    assert reason(desk, resume, ADAS_OTHER) == Reason.NO_OPERATOR
    beaten(desk, ADAS_OTHER)
    assert reason(desk, msgspec.structs.replace(resume, request_id=77), ADAS_OTHER) == Reason.NONE
    assert desk.vehicle.commands.driver == ADAS_OTHER
    pass_s(desk, 2.0, ADAS_OTHER)
    assert not lost(desk)


@each("held", [False, True])
def test_who_seizes_without_a_heartbeat_resumes_nothing(held: bool) -> None:
    """The heartbeat that it inherits keeps the drive for a moment, and makes nobody attend it."""
    desk = leased()
    beaten(desk, ADA)
    assert reason(desk, *guided(ADA)) == Reason.NONE
    if held:
        assert reason(desk, command(Command.DO_PAUSE_CONTINUE), ADA) == Reason.NONE
    reason(desk, ask(LeaseAction.SEIZE, "Bob"), BOB)
    resume = command(Command.DO_PAUSE_CONTINUE, 1.0)
    assert reason(desk, resume, BOB) == Reason.NO_OPERATOR
    assert reason(desk, *guided(BOB, 9)) == Reason.NO_OPERATOR
    beaten(desk, BOB)
    assert reason(desk, msgspec.structs.replace(resume, request_id=77), BOB) == Reason.NONE
    pass_s(desk, 2.0, BOB)
    assert not lost(desk)


def test_an_heir_who_leaves_has_no_heartbeat() -> None:
    desk = by_hand()
    reason(desk, ask(LeaseAction.SEIZE, "Bob"), BOB)
    reason(desk, ask(LeaseAction.LEAVE), BOB)
    desk.step()
    assert lost(desk)


def test_a_free_lease_that_is_taken_takes_over_the_drive() -> None:
    desk = by_hand()
    reason(desk, ask(LeaseAction.RELEASE), ADA)
    assert desk.vehicle.commands.driver == ADA
    assert not steer(desk, BOB, 300)
    reason(desk, ask(LeaseAction.TAKE, "Bob"), BOB)
    assert desk.vehicle.commands.driver == BOB


def test_a_lease_that_is_taken_makes_no_driver_of_its_holder() -> None:
    desk = armed()
    reason(desk, ask(LeaseAction.TAKE, "Ada"), ADA)
    assert desk.vehicle.commands.driver == ""


# What keeps the lease of an idle person.


def test_a_goal_keeps_the_lease_until_it_ends() -> None:
    desk = leased()
    assert reason(desk, goal(4, 20.0, 0.0), ADA) == Reason.NONE
    pass_s(desk, 40.0, ADA)
    assert desk.vehicle.lease.is_holder(ADA)
    assert reason(desk, command(Command.DO_PAUSE_CONTINUE), BOB) == Reason.NONE
    pass_s(desk, 29.9, ADA)
    assert desk.vehicle.lease.is_holder(ADA)
    pass_s(desk, 0.3, ADA)
    assert not desk.vehicle.lease.is_holder(ADA)
    assert IDLE[1] in published(desk)


@each(("speed_mm_s", "keeps"), [(200, True), (0, False)])
def test_sticks_keep_the_lease_unless_they_rest(speed_mm_s: int, keeps: bool) -> None:
    desk = by_hand()
    for _ in range(31):
        steer(desk, ADA, speed_mm_s)
        pass_s(desk, 1.0, ADA)
    assert desk.vehicle.lease.is_holder(ADA) == keeps


@each(
    ("asked", "keeps"),
    [
        (command(Command.COMPONENT_ARM_DISARM, 1.0), True),
        (command(Command.DO_PAUSE_CONTINUE), False),
        (ParamRequestRead(param_id="d_obs_m", param_index=-1), False),
    ],
)
def test_what_needs_the_lease_keeps_it(asked: Message, keeps: bool) -> None:
    desk = leased()
    pass_s(desk, 20.0, ADA)
    desk.vehicle.receive(asked, desk.now_ns, ADA)
    pass_s(desk, 11.0, ADA)
    assert desk.vehicle.lease.is_holder(ADA) == keeps


# The drive that is shown.


def test_the_newest_drive_is_shown_at_once() -> None:
    desk = leased()
    beaten(desk, ADA)
    assert desk.vehicle.lease_status(0, desk.now_ns) is not None
    shown = []
    for request in (goal(4, 20.0, 0.0), manual()):
        assert reason(desk, request, ADA) == Reason.NONE
        status = desk.vehicle.lease_status(0, desk.now_ns)
        assert status is not None
        shown.append((status.drive_id, status.driver))
    assert shown == [(4, "Ada"), (99, "Ada")]


# Clean-ups name what they end.


def clean_up(number: int, ends_id: int, request_id: int = 500) -> CommandRequest:
    return make(CommandRequest, request_id=request_id, command=number, ends_id=ends_id)


@each("number", [Command.DO_PAUSE_CONTINUE, Command.SIDESTEP_ABORT_GOAL])
def test_a_clean_up_ends_only_what_it_names(number: int) -> None:
    desk = leased()
    assert reason(desk, clean_up(number, 4), ADA) == Reason.ALREADY_OVER, "there was none"
    assert reason(desk, goal(4, 20.0, 0.0), ADA) == Reason.NONE
    assert reason(desk, goal(5, 30.0, 0.0), ADA) == Reason.NONE
    assert reason(desk, clean_up(number, 4, 501), ADA) == Reason.ALREADY_OVER
    assert desk.step().left_mrad_s > 0
    assert reason(desk, clean_up(number, 5, 502), ADA) == Reason.NONE
    for _ in range(40):
        assert desk.step().left_mrad_s >= 0
    assert desk.step().left_mrad_s == 0


def test_a_clean_up_of_a_goal_does_not_end_a_drive_by_hand() -> None:
    desk = leased()
    beaten(desk, ADA)
    assert reason(desk, goal(4, 20.0, 0.0), ADA) == Reason.NONE
    assert reason(desk, manual(), ADA) == Reason.NONE
    assert reason(desk, clean_up(Command.DO_PAUSE_CONTINUE, 4), ADA) == Reason.ALREADY_OVER
    assert desk.vehicle.state.machine.mode == states.MANUAL
    assert reason(desk, clean_up(Command.DO_PAUSE_CONTINUE, 99, 501), ADA) == Reason.NOTHING_KEPT
    assert desk.vehicle.state.machine.mode == states.HOLD


def test_a_clean_up_of_a_drive_does_not_end_a_goal() -> None:
    desk = leased()
    beaten(desk, ADA)
    assert reason(desk, manual(), ADA) == Reason.NONE
    assert reason(desk, goal(4, 20.0, 0.0), ADA) == Reason.NONE
    for number in (Command.DO_PAUSE_CONTINUE, Command.SIDESTEP_ABORT_GOAL):
        over = clean_up(number, 99, 500 + number)
        assert reason(desk, over, ADA) == Reason.ALREADY_OVER
    assert desk.step().left_mrad_s > 0


def test_a_clean_up_of_a_goal_that_has_ended_changes_nothing() -> None:
    desk = leased()
    assert reason(desk, goal(4, 20.0, 0.0), ADA) == Reason.NONE
    assert reason(desk, command(Command.SIDESTEP_ABORT_GOAL), ADA) == Reason.NONE
    before = desk.vehicle.state.machine.mode
    for number in (Command.DO_PAUSE_CONTINUE, Command.SIDESTEP_ABORT_GOAL):
        over = clean_up(number, 4, 500 + number)
        assert reason(desk, over, ADA) == Reason.ALREADY_OVER
    assert desk.vehicle.state.machine.mode == before


# Who has stopped what another person had begun.


ABORT, PAUSE = command(Command.SIDESTEP_ABORT_GOAL), command(Command.DO_PAUSE_CONTINUE)
DISARM = command(Command.COMPONENT_ARM_DISARM, 0.0)


def going() -> Desk:
    """Return a robot that drives to a goal of Ada's."""
    desk = leased()
    beaten(desk, ADA)
    assert reason(desk, goal(4, 20.0, 0.0), ADA) == Reason.NONE
    desk.step()
    told(desk)
    return desk


def told(desk: Desk) -> list[str]:
    """Return the texts of the robot since the last call."""
    texts = StatustextAssembler()
    return [words for one in desk.vehicle.texts() if (words := texts.receive(one))]


def status_of(desk: Desk) -> NavigatorStatus:
    commands = desk.vehicle.commands
    by = desk.vehicle.commands.stoppers
    return telemetry.status(desk.vehicle.state, commands.goal_id, desk.now_ns, 0, 0, by)


@each(
    ("stop", "words"),
    [
        (ABORT, "goal ABORTED by Bob"),
        (DISARM, "goal ABORTED: disarmed by Bob"),
    ],
)
def test_the_end_of_a_goal_names_the_other_person(stop: Message, words: str) -> None:
    desk = going()
    assert reason(desk, stop, BOB) == Reason.NONE
    assert status_of(desk).ended_by == "Bob"
    assert words in told(desk)
    armed = reason(desk, command(Command.COMPONENT_ARM_DISARM, 1.0), ADA)
    assert armed == (Reason.NOTHING_CHANGED if stop == ABORT else Reason.NONE)
    assert reason(desk, goal(6, 20.0, 0.0), ADA) == Reason.NONE
    assert status_of(desk).ended_by == "", "the next goal has not ended"


def test_the_end_of_a_goal_by_its_own_person_names_nobody() -> None:
    for program in (ADA, ADAS_OTHER):
        desk = going()
        assert reason(desk, ABORT, program) == Reason.NONE
        assert status_of(desk).ended_by == ""
        assert "goal ABORTED: by the operator" in told(desk)


def test_a_goal_that_ends_by_a_drive_of_another_names_who_drives() -> None:
    desk = going()
    reason(desk, ask(LeaseAction.SEIZE, "Bob"), BOB)
    beaten(desk, BOB)
    assert reason(desk, manual(), BOB) == Reason.NONE
    assert status_of(desk).ended_by == "Bob"
    assert "goal ABORTED: driven by hand by Bob" in told(desk)
    assert reason(desk, PAUSE, ADA) == Reason.NOTHING_KEPT
    assert (status_of(desk).ended_by, status_of(desk).held_by) == ("Bob", "Ada")


def test_a_goal_ends_by_a_drive_of_its_own_person() -> None:
    desk = going()
    beaten(desk, ADAS_OTHER)
    assert reason(desk, manual(), ADAS_OTHER) == Reason.NONE
    assert "goal ABORTED: driven by hand" in told(desk)


def test_a_hold_names_the_other_person_until_the_robot_goes_on() -> None:
    desk = going()
    assert reason(desk, PAUSE, BOB) == Reason.NONE
    assert (status_of(desk).held_by, status_of(desk).ended_by) == ("Bob", "")
    assert "mode HOLD by Bob" in told(desk)
    go_on = make(CommandRequest, request_id=7, command=Command.DO_PAUSE_CONTINUE, param1=1.0)
    assert reason(desk, go_on, ADA) == Reason.NONE
    assert status_of(desk).held_by == ""
    assert "mode AUTO" in told(desk)


def test_a_person_without_a_name_is_named_by_the_identity() -> None:
    desk = going()
    assert reason(desk, ABORT, "a-very-long-login-name/9") == Reason.NONE
    assert status_of(desk).ended_by == "a-very-long-logi"


def test_only_the_program_that_asked_is_named() -> None:
    """Another one of its person, by which it took the lease before, has done nothing."""
    desk = going()
    reason(desk, ask(LeaseAction.SEIZE, "first-prog"), BOB)
    hold = msgspec.structs.replace(PAUSE, sender="bob@desk:pts/1")
    assert reason(desk, hold, "bob/77") == Reason.NONE
    assert status_of(desk).held_by == "bob@desk:pts/1"
    assert "mode HOLD by bob@desk:pts/1" in told(desk)


GATE = "gateway-0123abcd/1"


def asked_by(number: int, request: CommandRequest) -> CommandRequest:
    """Return the request that a gateway passes on for a MAVLink client, with an id of its own."""
    name = f"MAVLink {number}"
    return msgspec.structs.replace(
        request, request_id=request.request_id * 1000 + number, sender=name
    )


def test_clients_of_one_gateway_are_told_apart() -> None:
    desk = armed()
    reason(desk, ask(LeaseAction.TAKE, "MAVLink 77"), GATE)
    own = msgspec.structs.replace(goal(4, 20.0, 0.0), sender="MAVLink 77")
    assert reason(desk, own, GATE) == Reason.NONE
    desk.step()
    told(desk)
    assert reason(desk, asked_by(77, PAUSE), GATE) == Reason.NONE
    assert status_of(desk).held_by == "", "its own client"
    go_on = command(Command.DO_PAUSE_CONTINUE, 1.0)
    assert reason(desk, asked_by(77, go_on), GATE) == Reason.NONE
    assert reason(desk, asked_by(255, PAUSE), GATE) == Reason.NONE
    assert status_of(desk).held_by == "MAVLink 255"
    assert reason(desk, asked_by(255, DISARM), GATE) == Reason.NONE
    assert status_of(desk).ended_by == "MAVLink 255"
    assert "goal ABORTED: disarmed by MAVLink 255" in told(desk)


def test_a_client_is_named_though_another_one_has_the_lease() -> None:
    desk = going()
    assert reason(desk, ask(LeaseAction.SEIZE, "MAVLink 255"), GATE) == Reason.NONE
    assert reason(desk, ask(LeaseAction.SEIZE, "Ada"), ADA) == Reason.NONE
    assert reason(desk, asked_by(77, DISARM), GATE) == Reason.NONE
    assert status_of(desk).ended_by == "MAVLink 77"


def test_a_drive_by_hand_names_who_has_disarmed_it() -> None:
    for program, name in ((BOB, "Bob"), (ADAS_OTHER, "")):
        desk = by_hand()
        assert reason(desk, DISARM, program) == Reason.NONE
        assert status_of(desk).held_by == name
        assert reason(desk, command(Command.COMPONENT_ARM_DISARM, 1.0), ADA) == Reason.NONE
        assert status_of(desk).held_by == "", "it is armed again"


def test_a_failsafe_after_a_hold_of_another_names_nobody() -> None:
    desk = going()
    assert reason(desk, PAUSE, BOB) == Reason.NONE
    desk.vehicle.stop(reasons.BUMPER, desk.now_ns)
    desk.step()
    assert status_of(desk).ended_by == ""


def on_a_mission() -> Desk:
    desk = going()
    reason(desk, ABORT, ADA)
    assert upload(desk, [item(0, 20.0)], ADA).reason == Reason.NONE
    start = make(CommandRequest, request_id=50, command=Command.MISSION_START)
    assert reason(desk, start, ADA) == Reason.NONE
    desk.step()
    told(desk)
    return desk


def mission_of(desk: Desk) -> MissionStatus:
    desk.step()
    return desk.vehicle.mission.status(0, desk.vehicle.commands.stoppers)


def test_a_mission_names_who_paused_it_and_who_took_it_over() -> None:
    desk = on_a_mission()
    stop = make(CommandRequest, request_id=51, command=Command.DO_PAUSE_CONTINUE)
    assert reason(desk, stop, BOB) == Reason.NONE
    assert (mission_of(desk).state, mission_of(desk).stopped_by) == (MissionState.PAUSED, "Bob")
    assert "mission PAUSED by Bob (item 1 of 1)" in told(desk)
    go_on = make(CommandRequest, request_id=52, command=Command.DO_PAUSE_CONTINUE, param1=1.0)
    assert reason(desk, go_on, ADA) == Reason.NONE
    assert mission_of(desk).stopped_by == ""
    reason(desk, ask(LeaseAction.SEIZE, "Bob"), BOB)
    assert reason(desk, goal(60, 10.0, 0.0), BOB) == Reason.NONE
    assert (mission_of(desk).reason, mission_of(desk).stopped_by) == (Reason.REPLACED, "Bob")
    assert "mission taken over: replaced by a new goal of Bob (item 1 of 1)" in told(desk)


@each("stop", [ABORT, DISARM])
def test_a_mission_names_who_ended_it(stop: Message) -> None:
    desk = on_a_mission()
    again = msgspec.structs.replace(stop, request_id=70)
    assert reason(desk, again, BOB) == Reason.NONE
    assert mission_of(desk).stopped_by == "Bob"


def test_a_mission_that_its_own_person_ends_names_nobody() -> None:
    desk = on_a_mission()
    again = msgspec.structs.replace(ABORT, request_id=70)
    assert reason(desk, again, ADAS_OTHER) == Reason.NONE
    assert mission_of(desk).stopped_by == ""


# What is accepted although there is nothing to do.


def test_a_hold_keeps_a_goal_only_if_there_is_one() -> None:
    desk = leased()
    assert reason(desk, PAUSE, ADA) == Reason.NOTHING_KEPT
    desk = going()
    assert reason(desk, PAUSE, ADA) == Reason.NONE


def test_a_clear_says_whether_a_stop_was_latched() -> None:
    desk = leased()
    clear = command(Command.SIDESTEP_CLEAR_EMERGENCY_STOP)
    answer = desk.vehicle.receive(clear, desk.now_ns, ADA)
    assert isinstance(answer, CommandAck)
    assert (answer.result, answer.result_param2) == (AckResult.ACCEPTED, Reason.NOTHING_LATCHED)
    desk.vehicle.receive(emergency_stop(9), desk.now_ns)
    again = msgspec.structs.replace(clear, request_id=80)
    assert reason(desk, again, ADA) == Reason.NONE


def test_the_program_whose_loss_stops_the_robot_is_named() -> None:
    desk = by_hand()
    told(desk)
    pass_s(desk, 2.0, ADAS_OTHER)
    assert lost(desk)
    assert "Ada fell silent: its drive was stopped" in told(desk)
