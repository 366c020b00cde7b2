"""Row 34: the fence by the mission protocol, and no rally points."""

from typing import Final

from ground.vehicle_check.check import Check
from ground.vehicle_check.dialect import mavlink
from ground.vehicle_check.missions import FENCE, RALLY, Item, download, upload
from ground.vehicle_check.plans import (
    ITEM_ACCEPTED,
    fence_around,
    keep,
    moved,
    outcome,
    place,
    same_places,
)  # fmt: skip
from ground.vehicle_check.rows.mission_rows import with_plans
from ground.vehicle_check.session import result_name
from ground.vehicle_check.verdict import Findings, Verdict, row

POLYGON_OUT: Final = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
CIRCLE: Final = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION
CIRCLE_OUT: Final = mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION
RADIUS_M: Final = 20.0
UNSUPPORTED: Final = mavlink.MAV_RESULT_UNSUPPORTED


@row(
    34,
    "fence: polygon and circle up and down, exclusions refused, FENCE_STATUS 1 Hz, 207; no rally",
    suffers="QGroundControl, Mission Planner, MAVProxy, MAVSDK geofence",
)
@with_plans
def fences(check: Check) -> Verdict:
    """Exchange fences, and ask for rally points."""
    found = Findings()
    keep(check, FENCE)
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
        done = upload(check.main, items, FENCE)
        is_refused = done.result is not None and done.result != ITEM_ACCEPTED
        found.expect(is_refused, f"{name}: {outcome(done.result)}")
    status = check.rate("FENCE_STATUS")
    if not 0.7 <= status <= 2.5:
        since = check.main.mark()
        check.station.wait(2.5)
        status = len(check.main.heard("FENCE_STATUS", since)) / 2.5
    found.expect(0.7 <= status <= 2.5, f"FENCE_STATUS {status:.1f} Hz")
    result = check.main.result_of(mavlink.MAV_CMD_DO_FENCE_ENABLE, 1)
    found.expect(result not in (None, UNSUPPORTED), f"207: {result_name(result)}")
    rally = download(check.main, RALLY)
    found.expect(rally is not None and not rally.items, f"rally: {rally and len(rally.items)}")
    return found.verdict()
