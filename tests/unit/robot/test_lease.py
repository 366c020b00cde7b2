"""The lease: at most one holder, shown to all operators, and released when its holder is lost."""

from hypothesis import given
from hypothesis import strategies as st

from protocol.wire.enums import AckResult, Command, LeaseAction, Mode, Severity
from protocol.wire.message import Message
from protocol.wire.messages import (
    CommandAck,
    CommandRequest,
    LeaseRequest,
    MissionCount,
    MissionRequestList,
    MissionVerdict,
    ParamRequestRead,
    ParamSet,
    ParamValue,
    Teleop,
)
from protocol.wire.reasons import Reason
from robot.lease import LAPSE_NS, Lease
from tests.support.each import each
from tests.support.robot.vehicles import MS, Desk, goal

ADA, BOB = "ada0", "bob0"
S = 1_000 * MS


def ask(action: int, name: str = "") -> LeaseRequest:
    return LeaseRequest(request_id=1, action=action, name=name)


def taken() -> Lease:
    lease = Lease()
    assert lease.receive(ask(LeaseAction.TAKE, "Ada"), ADA, 0) == Reason.NONE
    return lease


def test_without_a_holder_every_operator_may_command() -> None:
    lease = Lease()
    assert lease.allows(ADA)
    assert lease.allows("")
    assert lease.status(7, 0).held == 0
    assert lease.status(7, 0).holder == ""


def test_holder_commands_alone_and_is_named() -> None:
    lease = taken()
    assert lease.allows(ADA)
    assert not lease.allows(BOB)
    assert not lease.allows("")
    status = lease.status(7, 1 * S)
    assert (status.held, status.holder, status.name, status.lapses_ms) == (1, ADA, "Ada", 2000)
    assert lease.due(0) == [(Severity.INFO, "Ada has taken the lease")]


def test_other_operator_is_refused_until_the_release() -> None:
    lease = taken()
    assert lease.receive(ask(LeaseAction.TAKE), BOB, 0) == Reason.LEASE_HELD
    assert lease.receive(ask(LeaseAction.RELEASE), BOB, 0) == Reason.LEASE_HELD
    assert lease.receive(ask(LeaseAction.RELEASE), ADA, 0) == Reason.NONE
    assert lease.receive(ask(LeaseAction.TAKE), BOB, 0) == Reason.NONE
    assert lease.allows(BOB)


def test_release_without_a_holder_is_no_error() -> None:
    assert Lease().receive(ask(LeaseAction.RELEASE), BOB, 0) == Reason.NONE


def test_seizure_is_granted_with_a_critical_text() -> None:
    lease = taken()
    lease.due(0)
    assert lease.receive(ask(LeaseAction.SEIZE, "Bob"), BOB, 0) == Reason.NONE
    assert lease.due(0) == [(Severity.CRITICAL, "LEASE SEIZED by Bob from Ada")]
    assert not lease.allows(ADA)


def test_taking_it_twice_only_changes_the_name() -> None:
    lease = taken()
    lease.due(0)
    assert lease.receive(ask(LeaseAction.TAKE, "Ada L."), ADA, 0) == Reason.NONE
    assert lease.due(0) == []
    assert lease.status(0, 0).name == "Ada L."


def test_it_lapses_after_three_seconds_without_heartbeat() -> None:
    lease = taken()
    lease.refresh(1 * S)
    lease.due(1 * S)
    assert lease.due(1 * S + LAPSE_NS) == []
    assert not lease.allows(BOB)
    words = "lease of Ada lapsed: no heartbeat for 3 s"
    assert lease.due(1 * S + LAPSE_NS + 1) == [(Severity.WARNING, words)]
    assert lease.allows(BOB)


def test_the_three_seconds_count_from_when_it_was_taken() -> None:
    lease = Lease()
    lease.receive(ask(LeaseAction.TAKE, "Ada"), ADA, 10 * S)
    lease.due(10 * S)
    assert lease.status(0, 10 * S).lapses_ms == 3_000
    assert lease.due(13 * S) == []
    assert lease.is_holder(ADA)
    assert len(lease.due(13 * S + 1)) == 1
    assert not lease.is_holder(ADA)


def test_reordered_heartbeat_does_not_shorten_it() -> None:
    lease = taken()
    lease.refresh(2 * S)
    lease.refresh(1 * S)
    assert lease.status(0, 2 * S).lapses_ms == 3_000


def test_free_lease_has_no_time_and_no_name() -> None:
    for lease in (Lease(), taken()):
        lease.receive(ask(LeaseAction.RELEASE), ADA, 1 * S)
        status = lease.status(7, 1 * S)
        assert (status.time_ns, status.held, status.lapses_ms) == (7, 0, 0)
        assert (status.holder, status.name) == ("", "")
        assert lease.holder is None
        assert not lease.is_holder(ADA)
        assert not lease.is_holder("")


def test_release_is_announced() -> None:
    lease = taken()
    lease.due(0)
    lease.receive(ask(LeaseAction.RELEASE), ADA, 0)
    assert lease.due(0) == [(Severity.INFO, "Ada has released the lease")]
    lease.receive(ask(LeaseAction.RELEASE), ADA, 0)
    assert lease.due(0) == []


def test_sender_without_identity_cannot_hold_it() -> None:
    for action in LeaseAction:
        assert Lease().receive(ask(action), "", 0) == Reason.NO_OPERATOR


def test_control_characters_of_a_name_are_replaced() -> None:
    lease = Lease()
    lease.receive(ask(LeaseAction.TAKE, "A\x1b[2J\r\u202eb"), ADA, 0)
    assert lease.status(0, 0).name == "A?[2J??b"
    assert lease.due(0)[0][1] == "A?[2J??b has taken the lease"


def test_an_unknown_action_is_refused() -> None:
    assert Lease().receive(ask(9), ADA, 0) == Reason.UNKNOWN_COMMAND


def test_unnamed_operator_is_shown_by_its_identity() -> None:
    lease = Lease()
    lease.receive(ask(LeaseAction.TAKE), "0123456789abcdef", 0)
    assert lease.due(0)[0][1] == "01234567 has taken the lease"


steps = st.lists(
    st.tuples(
        st.sampled_from([*LeaseAction, None, 9]),
        st.sampled_from([ADA, BOB, ""]),
        st.integers(0, 4 * S),
    ),
    max_size=40,
)


@given(steps)
def test_any_order_of_requests_leaves_one_holder_at_most(
    asked: list[tuple[int | None, str, int]],
) -> None:
    """Compare with the rules, written independently; None is a heartbeat of the holder."""
    lease, holder, heard_ns, now_ns = Lease(), "", 0, 0
    for action, operator, later_ns in asked:
        now_ns += later_ns
        lease.due(now_ns)
        if holder and now_ns - heard_ns > LAPSE_NS:
            holder = ""
        if action is None:
            if lease.allows(operator):
                lease.refresh(now_ns)
            heard_ns = now_ns if operator == holder else heard_ns
            continue
        granted = lease.receive(ask(action), operator, now_ns) == Reason.NONE
        if action == LeaseAction.RELEASE:
            assert granted == (bool(operator) and holder in ("", operator))
            holder = "" if granted else holder
        else:
            wants = action in (LeaseAction.TAKE, LeaseAction.SEIZE) and operator
            free = holder in ("", operator) or action == LeaseAction.SEIZE
            assert granted == bool(wants and free)
            holder, heard_ns = (operator, now_ns) if granted else (holder, heard_ns)
        assert [who for who in (ADA, BOB) if lease.allows(who)] == (
            [holder] if holder else [ADA, BOB]
        )
        assert lease.status(0, now_ns).held == bool(holder)


# The lease at the vehicle.


def leased() -> Desk:
    """Return an armed robot whose lease Ada holds."""
    desk = Desk()
    desk.arm()
    assert reason(desk, ask(LeaseAction.TAKE, "Ada"), ADA) == Reason.NONE
    return desk


def reason(desk: Desk, request: Message, operator: str) -> int:
    answer = desk.vehicle.receive(request, desk.now_ns, operator)
    if isinstance(answer, MissionVerdict):
        return answer.reason
    assert isinstance(answer, CommandAck)
    assert (answer.result == AckResult.ACCEPTED) == (answer.result_param2 == Reason.NONE)
    return answer.result_param2


def command(number: int, param1: float = 0.0) -> CommandRequest:
    number_of_request = number * 10 + int(param1)
    return CommandRequest(request_id=number_of_request, command=number, param1=param1, param2=0.0)


@each(
    "request_of_other",
    [
        command(Command.COMPONENT_ARM_DISARM),
        command(Command.DO_PAUSE_CONTINUE),
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


def test_reading_needs_no_lease() -> None:
    desk = leased()
    read = desk.vehicle.receive(ParamRequestRead(param_id="d_obs_m", param_index=-1), 0, BOB)
    assert isinstance(read, ParamValue)
    assert desk.vehicle.receive(MissionRequestList(), 0, BOB) == MissionCount(count=0)


def test_refused_request_is_checked_again_when_repeated() -> None:
    desk = leased()
    hold = command(Command.DO_PAUSE_CONTINUE)
    assert reason(desk, hold, BOB) == Reason.LEASE_HELD
    reason(desk, ask(LeaseAction.RELEASE), ADA)
    assert reason(desk, hold, BOB) == Reason.NONE


def test_losing_the_lease_ends_teleop() -> None:
    desk = leased()
    desk.operator = True
    desk.step()
    assert reason(desk, manual(), ADA) == Reason.NONE
    frame = Teleop(time_ns=0, seq=0, speed_mm_s=200, yaw_rate_mrad_s=0, ttl_ms=500)
    desk.vehicle.receive_teleop(frame, desk.now_ns)
    assert desk.vehicle.teleop.newest(desk.now_ns) == frame
    reason(desk, ask(LeaseAction.SEIZE, "Bob"), BOB)
    assert desk.vehicle.teleop.newest(desk.now_ns) is None


def manual() -> CommandRequest:
    mode = float(Mode.MANUAL)
    return CommandRequest(request_id=99, command=Command.DO_SET_MODE, param1=1.0, param2=mode)


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
    for _ in range(70):
        desk.step()
        desk.vehicle.lease_status(desk.now_ns, desk.now_ns)
    published = "".join(text.text for text in desk.vehicle.texts())
    assert "lease of Ada lapsed: no heartbeat for 3 s" in published
    assert desk.vehicle.lease.allows(BOB)
