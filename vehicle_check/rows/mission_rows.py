"""Rows 27-35, 68, 72: missions up and down, lost frames, two clients, refusals, ids, the fence.

There are no rally points.
"""

import re
from collections.abc import Callable
from functools import partial, wraps
from typing import Any, Final

from runtime.units import NS_PER_S
from vehicle_check import row_steps
from vehicle_check.ground_stations import result_name
from vehicle_check.mavlink_frames import mavlink
from vehicle_check.row_steps import (
    ITEM_ACCEPTED,
    fence_around,
    home,
    is_disarmed_or_allowed,
    keep_plan,
    moved,
    place,
    plan_result_name,
    same_places,
    send_plan,
    small_mission,
    step_m,
)
from vehicle_check.transfers import (
    FENCE,
    MISSION,
    RALLY,
    REQUESTS,
    PlanItem,
    count_message,
    download_plan,
    message_of,
    upload_plan,
)
from vehicle_check.vehicle_under_test import (
    ARDUPILOTS,
    ONE_CLIENT,
    Findings,
    Judge,
    RowVerdict,
    VehicleChange,
    VehicleCheck,
    failed,
    not_applicable,
    not_tried,
    row,
)

CANCEL_S: Final = 12.0
OWN_CANCELLED: Final = mavlink.MAV_MISSION_OPERATION_CANCELLED
DENIED: Final = mavlink.MAV_MISSION_DENIED
NO_COMMAND: Final = 31_999
UNREADABLE: Final = "the vehicle's own plan cannot be downloaded, and is not replaced"
MOST_ITEMS: Final = 65_535
ITEM_2: Final = re.compile(r"(?<![\d.])[23](?![\d.])")
"""The number of the third item, counted from 0 or from 1, not a digit of another number."""


def with_plans(judge: Judge) -> Judge:
    """Save the vehicle's own mission before a row sends another one."""

    @wraps(judge)
    def judged(check: VehicleCheck) -> RowVerdict:
        if not is_disarmed_or_allowed(check):
            return not_tried("the vehicle is armed: give --allow-motion")
        if place(check) == (0, 0) and not check.main.expect_sent("GLOBAL_POSITION_INT", 1.0):
            return failed("no GLOBAL_POSITION_INT: no place for a mission")
        if not keep_plan(check, MISSION):
            return failed(UNREADABLE)
        return judge(check)

    return judged


def _is_no_acceptance(message: Any) -> bool:
    """Return False for an acceptance: with loss it may be a copy, for an earlier upload."""
    return bool(getattr(message, "type", None) != ITEM_ACCEPTED)


@row(
    27,
    "upload: asks again for a lost item, last item acknowledged again, cancelled at the end",
    suffers="MAVSDK, MAVProxy on a line with loss",
    source="MAVLink guide, mission protocol; MAVSDK; MAVProxy",
)
@with_plans
def upload_retries(check: VehicleCheck) -> RowVerdict:
    """Leave one request unanswered, repeat the last item, and abandon an upload."""
    found, items = Findings(), small_mission(check)
    done = upload_plan(check.main, items, ignored=1)
    times = [seq for _, seq in done.requests].count(1)
    fact = f"item 1 asked for {times} times, {plan_result_name(done.result)}"
    found.expect(times >= 2 and done.result == ITEM_ACCEPTED, fact)
    last = len(items) - 1
    repeated = message_of(check.main, items[last], last, MISSION)
    again = check.main.ask(repeated, "MISSION_ACK")
    result = None if again is None else again.message.type
    found.expect(result == ITEM_ACCEPTED, f"last item again: {plan_result_name(result)}")
    ended = check.once("abandoned", lambda: _abandoned(check))["ended"]
    found.expect(ended == OWN_CANCELLED, f"upload without answers: {plan_result_name(ended)}")
    return found.verdict()


def _abandoned(check: VehicleCheck) -> dict[str, int | None]:
    """Start an upload, send requests of a second client meanwhile, and wait for its end."""
    main = check.main
    since = main.mark()
    main.ask_for_any(count_message(main, 3, MISSION), REQUESTS)
    target = check.station.address
    listing = mavlink.MAVLink_mission_request_list_message(*target, MISSION)
    found: dict[str, int | None] = {}
    if check.serves_two:
        other = check.second
        for name, message in (("count", count_message(other, 2, MISSION)), ("list", listing)):
            answer = other.ask(message, "MISSION_ACK", within_s=0.6)
            found[name] = None if answer is None else int(answer.message.type)
    is_end = _is_no_acceptance if check.station.is_lossy else None
    ended = main.expect_sent("MISSION_ACK", CANCEL_S, is_end, since)
    found["ended"] = None if ended is None else int(ended.message.type)
    return found


@row(
    28,
    "items are asked for by MISSION_REQUEST, ITEM and ITEM_INT are taken",
    suffers="DroneKit answers only MISSION_REQUEST",
    source="DroneKit; ArduPilot GCS_MAVLink/MissionItemProtocol.cpp",
    profiles=ARDUPILOTS,
)
@with_plans
def item_kinds(check: VehicleCheck) -> RowVerdict:
    """Upload with each kind of item."""
    found, items = Findings(), small_mission(check)
    for as_float in (True, False):
        done = upload_plan(check.main, items, as_float=as_float)
        names = sorted({name for name, _ in done.requests})
        kind = "ITEM" if as_float else "ITEM_INT"
        is_right = done.result == ITEM_ACCEPTED and names == ["MISSION_REQUEST"]
        found.expect(is_right, f"{kind} by {names}: {plan_result_name(done.result)}")
    return found.verdict()


@row(
    29,
    "MISSION_REQUEST gives ITEM, MISSION_REQUEST_INT gives ITEM_INT; partial lists",
    suffers="DroneKit, mavros; MAVProxy edits with partial lists",
    source="MAVLink guide, mission protocol; DroneKit; mavros; MAVProxy",
    profiles=ARDUPILOTS,
)
@with_plans
def item_requests(check: VehicleCheck) -> RowVerdict:
    """Download with each request, and write a part."""
    found, items = Findings(), small_mission(check)
    send_plan(check, items)
    for as_float in (True, False):
        got = download_plan(check.main, as_float=as_float)
        name = "MISSION_REQUEST" if as_float else "MISSION_REQUEST_INT"
        count = None if got is None else len(got.items)
        found.expect(count == len(items), f"{name}: {count} items")
    target = check.station.address
    partial = mavlink.MAVLink_mission_write_partial_list_message(*target, 1, 1, MISSION)
    is_answer = _is_no_acceptance if check.station.is_lossy else None
    answer = check.main.ask_for_any(partial, (*REQUESTS, "MISSION_ACK"), is_answer)
    if found.expect(answer, f"WRITE_PARTIAL_LIST: {answer.name if answer else 'no answer'}"):
        _finish_partial(check, found, items, answer)
    return found.verdict()


def _finish_partial(
    check: VehicleCheck, found: Findings, items: list[PlanItem], answer: Any
) -> None:
    if answer.name == "MISSION_ACK":
        found.expect(answer.message.type != ITEM_ACCEPTED, plan_result_name(answer.message.type))
        return
    item = message_of(check.main, items[2], 1, MISSION)
    ack = check.main.ask(item, "MISSION_ACK")
    result = None if ack is None else ack.message.type
    found.expect(result == ITEM_ACCEPTED, f"partial: {plan_result_name(result)}")


@row(
    30,
    "item 0 is home in both directions",
    suffers="DroneKit, MAVProxy, QGroundControl: missions shifted by one",
    source="ArduPilot GCS_MAVLink/MissionItemProtocol.cpp; QGroundControl PlanManager.cc",
    profiles=ARDUPILOTS,
)
@with_plans
def home_item(check: VehicleCheck) -> RowVerdict:
    """Upload with home first; item 0 comes back at home, the others as they were."""
    found, items = Findings(), small_mission(check)
    result = send_plan(check, items)
    found.expect(result == ITEM_ACCEPTED, f"upload: {plan_result_name(result)}")
    got = download_plan(check.main)
    count = None if got is None else len(got.items)
    if not found.expect(count == len(items), f"{count} of {len(items)} items") or got is None:
        return found.verdict()
    found.expect(same_places(got.items, items, skip=1), "items 1 and later as sent")
    at, first = home(check), (got.items[0].x, got.items[0].y)
    is_home = at is not None and abs(first[0] - at[0]) <= 2 and abs(first[1] - at[1]) <= 2
    found.expect(is_home, f"item 0 at {first}, home {at}")
    return found.verdict()


@row(
    31,
    "MISSION_SET_CURRENT and 224 answered at once by MISSION_CURRENT; 1 Hz with total and state",
    suffers="MAVSDK sends again for any other seq",
    source="MAVLink guide, mission protocol; MAVSDK",
)
@with_plans
def current_item(check: VehicleCheck) -> RowVerdict:
    """Choose items in both ways, and 0."""
    found, items = Findings(), small_mission(check)
    send_plan(check, items)
    target = check.station.address
    number = mavlink.MAV_CMD_DO_SET_MISSION_CURRENT
    asked = {
        "MISSION_SET_CURRENT 2": (mavlink.MAVLink_mission_set_current_message(*target, 2), 2),
        "224 with 1": (check.main.command_long(number, 1), 1),
        "MISSION_SET_CURRENT 0": (mavlink.MAVLink_mission_set_current_message(*target, 0), 0),
    }
    for way, (message, seq) in asked.items():
        start_ns = check.station.now_ns
        # The one that is due each second may cross the request.
        answer = check.main.ask(message, "MISSION_CURRENT", _numbered(seq), within_s=0.5)
        late_s = (check.station.now_ns - start_ns) / NS_PER_S
        last = check.main.latest("MISSION_CURRENT")
        got = last and last.message.seq
        found.expect(answer is not None, f"{way}: seq {got} after {late_s:.2f} s")
    since = check.main.mark()
    check.station.wait(3.2)
    frames = check.main.sent("MISSION_CURRENT", since)
    found.expect(2 <= len(frames) <= 8, f"{len(frames)} in 3 s")
    if frames:
        one = frames[-1].message
        found.expect(one.total in (len(items), len(items) - 1), f"total {one.total}")
        found.expect(one.mission_state, f"mission_state {one.mission_state}")
    return found.verdict()


@row(
    32,
    "during an upload a second client's MISSION_COUNT and REQUEST_LIST are DENIED",
    suffers="two ground stations mix their missions",
    source="ArduPilot GCS_MAVLink/MissionItemProtocol.cpp",
    profiles=ARDUPILOTS,
)
@with_plans
def two_uploads(check: VehicleCheck) -> RowVerdict:
    """Judge the answers to the second client."""
    found, answers = Findings(), check.once("abandoned", lambda: _abandoned(check))
    if not check.serves_two:
        return not_applicable(ONE_CLIENT)
    for name in ("count", "list"):
        found.expect(
            answers[name] == DENIED, f"{name} of the second: {plan_result_name(answers[name])}"
        )
    return found.verdict()


@row(
    33,
    "refusals: the right MISSION_ACK, and a STATUSTEXT with item and reason",
    suffers="MAVSDK and QGroundControl users: no reason shown",
    source="MAVLink guide, mission protocol; MAVSDK",
)
@with_plans
def refusals(check: VehicleCheck) -> RowVerdict:
    """Send missions with one fault each."""
    found, items = Findings(), small_mission(check)
    here = moved(place(check), 0.1, 0.1)
    invalid = {mavlink.MAV_MISSION_INVALID_PARAM5_X, mavlink.MAV_MISSION_INVALID}
    faults = (
        ("command", PlanItem(NO_COMMAND, *here), {mavlink.MAV_MISSION_UNSUPPORTED}),
        ("frame", PlanItem(16, *here, frame=17), {mavlink.MAV_MISSION_UNSUPPORTED_FRAME}),
        ("latitude", PlanItem(16, 910_000_000, here[1]), invalid),
    )
    for name, wrong, results in faults:
        since = check.main.mark()
        done = upload_plan(check.main, [*items[:2], wrong])
        check.station.wait(0.3)
        text = check.texts(since)
        found.expect(done.result in results, f"{name}: {plan_result_name(done.result)}")
        found.expect(ITEM_2.search(text), f"text {text!r}")
    answer = check.main.ask(count_message(check.main, MOST_ITEMS, MISSION), "MISSION_ACK")
    result = None if answer is None else answer.message.type
    found.expect(
        result == mavlink.MAV_MISSION_NO_SPACE, f"{MOST_ITEMS} items: {plan_result_name(result)}"
    )
    return found.verdict()


def _numbered(seq: int) -> Callable[[Any], bool]:
    return lambda one: bool(one.seq == seq)


@row(
    35,
    "opaque ids in COUNT, ACK and CURRENT change with the plan",
    suffers="ground stations download each plan again",
    source="MAVLink guide, mission protocol, plan ids",
)
@with_plans
def opaque_ids(check: VehicleCheck) -> RowVerdict:
    """Compare the ids of two plans, and those of one in three messages."""
    found, seen = Findings(), []
    for steps in (2, 3):
        done = upload_plan(check.main, small_mission(check, steps))
        got = download_plan(check.main)
        current = check.main.expect_sent("MISSION_CURRENT", 2.0)
        count = None if got is None else got.opaque_id
        now = None if current is None else current.message.mission_id
        fact = f"ACK {done.opaque_id} COUNT {count} CURRENT {now}"
        found.expect(done.opaque_id and count == done.opaque_id == now, fact)
        seen.append(count)
    found.expect(len(set(seen)) == 2, f"two plans: {seen}")
    return found.verdict()


WAYPOINT: Final = mavlink.MAV_CMD_NAV_WAYPOINT
ALTITUDES_M: Final = (10.0, 600.0, 7.5)
KINDS: Final = {0: "global", 5: "global", 3: "relative", 6: "relative"}
"""A frame and that with integers mean the same."""


@row(
    68,
    "an item reads back as it was sent: altitude, parameters, kind of frame",
    suffers="clients that verify an upload: QGroundControl, mavctl, the Methodic Configurator",
    source="MAVLink guide, mission protocol; ArduPilot AP_Mission.cpp",
)
@with_plans
def same_items(check: VehicleCheck) -> RowVerdict:
    """Upload items with values in all fields, and compare those that come back.

    A value of 0 must stay 0. ArduPilot keeps of a rover's waypoint only the first parameter.
    """
    found, here = Findings(), place(check)
    places = [moved(here, 0.3 * number, 0.2) for number in (1, 2, 3)]
    first, second, third = ALTITUDES_M
    items = [
        *small_mission(check, 0),
        PlanItem(WAYPOINT, *places[0], mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, z=first),
        PlanItem(WAYPOINT, *places[1], mavlink.MAV_FRAME_GLOBAL, (1.0, 0.5, 0.0, 0.0), second),
        PlanItem(WAYPOINT, *places[2], mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT, z=third),
    ]
    since = check.main.mark()
    result = upload_plan(check.main, items).result
    fact = f"upload: {plan_result_name(result)} {check.texts(since)}"
    if not found.expect(result == ITEM_ACCEPTED, fact):
        return found.verdict()
    got = download_plan(check.main)
    if got is None or len(got.items) != len(items):
        return failed(f"{None if got is None else len(got.items)} of {len(items)} items came back")
    pairs = list(zip(items, got.items, strict=True))[1:]
    for number, (sent, back) in enumerate(pairs, start=1):
        wrong = _changed_fields(sent, back)
        found.expect(not wrong, f"item {number}: {', '.join(wrong) or 'as sent'}")
    return found.verdict()


def _changed_fields(sent: PlanItem, back: PlanItem) -> list[str]:
    """Return what differs in an item that came back."""
    wrong = [] if same_places([sent], [back]) else ["place"]
    if abs(sent.z - back.z) > NEAR_M:
        wrong.append(f"altitude {sent.z:g} -> {back.z:g}")
    if KINDS.get(sent.frame) != KINDS.get(back.frame):
        wrong.append(f"frame {sent.frame} -> {back.frame}")
    for number, (one, other) in enumerate(zip(sent.params, back.params, strict=True), start=1):
        is_dropped = number > 1 and other == 0
        if not (is_dropped or abs(one - other) <= NEAR_M):  # NaN is not near
            wrong.append(f"param{number} {one:g} -> {other:g}")
    return wrong


NEAR_M: Final = 0.01
PLAN_S: Final = 60.0
SLOW_M_S: Final = 0.2
DELAY_S: Final = 1.0


@row(
    72,
    "a plan with a change of speed, a delay and a return at its end is driven, not refused",
    suffers="QGroundControl and Mission Planner: usual plans cannot be uploaded",
    source="QGroundControl PlanManager.cc; ArduPilot Rover/mode_auto.cpp",
    profiles=ARDUPILOTS,
)
@with_plans
def usual_plan(check: VehicleCheck) -> RowVerdict:
    """Upload such a plan and compare it; with motion, drive it until it returns."""
    found, here = Findings(), place(check)
    step = max(0.5, step_m(check))
    items = [
        *small_mission(check, 0),
        PlanItem(WAYPOINT, *moved(here, step, 0.0)),
        PlanItem(mavlink.MAV_CMD_DO_CHANGE_SPEED, 0, 0, params=(1.0, SLOW_M_S, -1.0, 0.0)),
        PlanItem(WAYPOINT, *moved(here, step, step)),
        PlanItem(mavlink.MAV_CMD_NAV_DELAY, 0, 0, params=(DELAY_S, -1.0, -1.0, -1.0)),
        PlanItem(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, 0, 0),
    ]
    since = check.main.mark()
    result = upload_plan(check.main, items).result
    fact = f"upload: {plan_result_name(result)} {check.texts(since)}"
    if not found.expect(result == ITEM_ACCEPTED, fact):
        return found.verdict()
    got = download_plan(check.main)
    commands = None if got is None else [one.command for one in got.items]
    found.expect(commands == [one.command for one in items], f"back: {commands}")
    if not (check.options.allow_motion and check.is_rover):
        found.fact("driving not tried")
        return found.verdict()
    row_steps.stand(check)
    if row_steps.start(check, row_steps.GUIDED, found):
        _expect_driven(check, found, len(items) - 1)
    row_steps.stand(check)
    return found.verdict()


def _expect_driven(check: VehicleCheck, found: Findings, last: int) -> None:
    """Start the mission; expect that its last item is reached or begun."""
    since = check.main.mark()
    started = check.main.result_of(mavlink.MAV_CMD_MISSION_START, within_s=2.0)

    def is_at_end() -> bool:
        if check.main.sent("MISSION_ITEM_REACHED", since, lambda one: one.seq >= last - 1):
            return True
        return bool(check.main.sent("MISSION_CURRENT", since, lambda one: one.seq >= last))

    is_driven = check.station.wait(PLAN_S, is_at_end)
    current = check.main.latest("MISSION_CURRENT")
    seq = None if current is None else current.message.seq
    fact = f"started: {result_name(started)}, item {seq} of {last}"
    found.expect(is_driven, fact if is_driven else f"{fact} {check.texts(since)!r}")


POLYGON_OUT: Final = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
CIRCLE: Final = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
CIRCLE_OUT: Final = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION
RADIUS_M: Final = 20.0
GEOFENCE: Final = mavlink.MAV_SYS_STATUS_GEOFENCE
WATCH_S: Final = 3.0
LEAST_HZ: Final = 0.6
MOST_HZ: Final = 2.5
ACCEPTED: Final = mavlink.MAV_RESULT_ACCEPTED
UNSUPPORTED: Final = mavlink.MAV_RESULT_UNSUPPORTED


@row(
    34,
    "fence: polygon and circle up and down, exclusions kept or refused, FENCE_STATUS 1 Hz, 207",
    suffers="QGroundControl, Mission Planner, MAVProxy, MAVSDK geofence",
    source="MAVLink guide, mission protocol; QGroundControl; MAVProxy",
    profiles=ARDUPILOTS,
)
@with_plans
def fences(check: VehicleCheck) -> RowVerdict:
    """Exchange fences, and ask for rally points."""
    found = Findings()
    _keep_enabled(check)
    if not keep_plan(check, FENCE):
        return failed(UNREADABLE)
    polygon = fence_around(check)
    circle = PlanItem(CIRCLE, *moved(place(check), 0.5, 0.5), params=(RADIUS_M, 0.0, 0.0, 0.0))
    for name, items in (("circle", [circle]), ("polygon", polygon)):
        done = upload_plan(check.main, items, FENCE)
        got = download_plan(check.main, FENCE)
        is_same = got is not None and same_places(got.items, items)
        answer, back = plan_result_name(done.result), "same" if is_same else "differs"
        fact = f"{name}: {answer}, {back} on download"
        found.expect(done.result == ITEM_ACCEPTED and is_same, fact)
    outside = [one._replace(command=POLYGON_OUT) for one in polygon]
    for name, items in (("5002", outside), ("5004", [circle._replace(command=CIRCLE_OUT)])):
        _expect_refused_or_kept(check, found, name, items)
    upload_plan(check.main, polygon, FENCE)
    result = check.main.result_of(mavlink.MAV_CMD_DO_FENCE_ENABLE, 1)
    found.expect(result not in (None, UNSUPPORTED), f"207: {result_name(result)}")
    since = check.main.mark()
    check.station.wait(WATCH_S)
    status = len(check.main.sent("FENCE_STATUS", since)) / WATCH_S
    found.expect(LEAST_HZ <= status <= MOST_HZ, f"FENCE_STATUS {status:.1f} Hz")
    rally = download_plan(check.main, RALLY)
    count = None if rally is None else len(rally.items)
    found.expect(count == 0 or (count and _has_rally(check)), f"rally: {count}")
    return found.verdict()


def _expect_refused_or_kept(
    check: VehicleCheck, found: Findings, name: str, items: list[PlanItem]
) -> None:
    """Expect that an exclusion is refused, or comes back as it was sent."""
    done = upload_plan(check.main, items, FENCE)
    if done.result != ITEM_ACCEPTED:
        found.expect(done.result is not None, f"{name}: {plan_result_name(done.result)}")
        return
    got = download_plan(check.main, FENCE)
    is_same = got is not None and same_places(got.items, items)
    fact = (
        f"{name}: {plan_result_name(done.result)}, {'same' if is_same else 'differs'} on download"
    )
    found.expect(is_same, fact)


def _has_rally(check: VehicleCheck) -> bool:
    """Return True if the vehicle's capabilities contain rally points."""
    version = check.main.request(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, "AUTOPILOT_VERSION")
    bit = mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
    return version is not None and bool(version.message.capabilities & bit)


def _keep_enabled(check: VehicleCheck) -> None:
    """Disable the fence after the check if it is disabled now."""
    status = check.main.latest("SYS_STATUS")
    if status is None or status.message.onboard_control_sensors_enabled & GEOFENCE:
        return
    disable = partial(check.main.result_of, mavlink.MAV_CMD_DO_FENCE_ENABLE, 0)
    check.restore.append(VehicleChange("fence disabled", lambda: disable() == ACCEPTED))
