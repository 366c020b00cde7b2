"""Row 34: the fence by the mission protocol, and no rally points."""

from functools import partial
from typing import Final

from vehicle_check.check import Check, Restore
from vehicle_check.dialect import mavlink
from vehicle_check.missions import FENCE, RALLY, Item, download, upload
from vehicle_check.plans import (
    ITEM_ACCEPTED,
    fence_around,
    keep,
    moved,
    outcome,
    place,
    same_places,
)  # fmt: skip
from vehicle_check.rows.mission_rows import UNREADABLE, with_plans
from vehicle_check.session import result_name
from vehicle_check.verdict import Findings, Verdict, failed, row

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
)
@with_plans
def fences(check: Check) -> Verdict:
    """Exchange fences, and ask for rally points."""
    found = Findings()
    _keep_enabled(check)
    if not keep(check, FENCE):
        return failed(UNREADABLE)
    polygon = fence_around(check)
    circle = Item(CIRCLE, *moved(place(check), 0.5, 0.5), params=(RADIUS_M, 0.0, 0.0, 0.0))
    for name, items in (("circle", [circle]), ("polygon", polygon)):
        done = upload(check.main, items, FENCE)
        got = download(check.main, FENCE)
        is_same = got is not None and same_places(got.items, items)
        fact = f"{name}: {outcome(done.result)}, {'same' if is_same else 'differs'} on download"
        found.expect(done.result == ITEM_ACCEPTED and is_same, fact)
    outside = [one._replace(command=POLYGON_OUT) for one in polygon]
    for name, items in (("5002", outside), ("5004", [circle._replace(command=CIRCLE_OUT)])):
        _expect_refused_or_kept(check, found, name, items)
    upload(check.main, polygon, FENCE)
    result = check.main.result_of(mavlink.MAV_CMD_DO_FENCE_ENABLE, 1)
    found.expect(result not in (None, UNSUPPORTED), f"207: {result_name(result)}")
    since = check.main.mark()
    check.station.wait(WATCH_S)
    status = len(check.main.sent("FENCE_STATUS", since)) / WATCH_S
    found.expect(LEAST_HZ <= status <= MOST_HZ, f"FENCE_STATUS {status:.1f} Hz")
    rally = download(check.main, RALLY)
    count = None if rally is None else len(rally.items)
    found.expect(count == 0 or (count and _has_rally(check)), f"rally: {count}")
    return found.verdict()


def _expect_refused_or_kept(check: Check, found: Findings, name: str, items: list[Item]) -> None:
    """Expect that an exclusion is refused, or comes back as it was sent."""
    done = upload(check.main, items, FENCE)
    if done.result != ITEM_ACCEPTED:
        found.expect(done.result is not None, f"{name}: {outcome(done.result)}")
        return
    got = download(check.main, FENCE)
    is_same = got is not None and same_places(got.items, items)
    fact = f"{name}: {outcome(done.result)}, {'same' if is_same else 'differs'} on download"
    found.expect(is_same, fact)


def _has_rally(check: Check) -> bool:
    """Return True if the vehicle's capabilities contain rally points."""
    version = check.main.request(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, "AUTOPILOT_VERSION")
    bit = mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
    return version is not None and bool(version.message.capabilities & bit)


def _keep_enabled(check: Check) -> None:
    """Disable the fence after the check if it is disabled now."""
    status = check.main.latest("SYS_STATUS")
    if status is None or status.message.onboard_control_sensors_enabled & GEOFENCE:
        return
    disable = partial(check.main.result_of, mavlink.MAV_CMD_DO_FENCE_ENABLE, 0)
    check.restore.append(Restore("fence disabled", lambda: disable() == ACCEPTED))
