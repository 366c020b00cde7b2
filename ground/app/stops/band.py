"""Make the band that says which robot has stopped, why, and which keys lead back to driving."""

from collections.abc import Callable, Sequence
from textwrap import wrap
from typing import Final, NamedTuple

from ground.app.panels.aged import live
from ground.app.stops.stop_watch import STOPPED, is_known
from ground.app.widgets.rows import Row, Span, cut, row
from ground.client.lost_drive import LostDrive, LostMission, has_failed, lost_drive
from ground.client.telemetry import Age
from ground.station.fleet import RosterEntry
from ground.station.station import Station
from ground.text.wording import STOPS
from protocol.topics import MISSION, ODOMETRY, STATUS
from protocol.wire.enums import Mode, Vehicle
from protocol.wire.messages import MissionStatus, NavigatorStatus, PlanarOdometry
from protocol.wire.reasons import Reason, reason_text
from runtime.units import NS_PER_MS, NS_PER_S

FENCE_OFF: Final = ":fence off"


class Step(NamedTuple):
    """A key or command, what it does, and in long form where to."""

    key: str
    does: str
    where: str = ""

    @property
    def long(self) -> str:
        """The key with what it does."""
        return " ".join(filter(None, (self.key, self.does, self.where)))

    @property
    def short(self) -> str:
        """The key with what it does, in few words."""
        return f"{self.key} {self.does}"


def next_steps(
    status: NavigatorStatus,
    lost: LostDrive | None,
    key_of: Callable[[str], str],
    *,
    is_placed: bool = True,
) -> list[Step]:
    """Return the steps that lead from the present state to driving.

    `key_of` returns the key of an action by its id. `is_placed`: the robot knows its place.
    """
    steps: list[Step] = []
    if status.vehicle == Vehicle.EMERGENCY_STOP:
        clear = key_of("clear-estop")
        steps.append(Step(clear if clear.startswith(":") else f"{clear} {clear}", "clear"))
    if status.vehicle_reason == Reason.FENCE_BREACHED:
        steps.append(Step(FENCE_OFF, "lift the fence"))
    if status.vehicle_reason == Reason.FENCE_UNCHECKED or not is_placed:
        steps.append(Step(key_of("place"), "set the place"))
    if status.vehicle != Vehicle.ACTIVE:
        steps.append(Step(key_of("arm"), "arm"))
    if lost is None:
        return [*steps, Step(key_of("goal"), "goal")]
    onto = "with" if isinstance(lost, LostMission) else "to"
    return [*steps, Step(key_of("resume"), "go on", f"{onto} {lost}")]


def forms(steps: list[Step], where: str) -> list[str]:
    """Return the steps in words, the longest form first; `where` names the screen that has them."""
    long = ", ".join(step.long for step in steps)
    short = ", ".join(step.short for step in steps)
    keys = [step.key for step in steps]
    if where:
        return [
            f"{where}, then {long}",
            f"{where}, then {short}",
            "  ".join((where.split()[0], *keys)),
        ]
    return [long, short, "  ".join(keys)]


BAND_ROLES: Final = {Vehicle.EMERGENCY_STOP: "alarm", Vehicle.FAILSAFE: "failsafe"}
NEXT_ROLE: Final = "caution"
STANDING_M_S: Final = 0.01
STANDING_RAD_S: Final = 0.02
LONG_S: Final = 120
GAP: Final = 4
LOW, TALL = 4, 12
"""Below LOW rows of the terminal the band has one row, from TALL rows on it has three."""


class BandKeys(NamedTuple):
    """The keys that the band names: `of` by the id of an action, `where` they are active."""

    of: Callable[[str], str]
    where: str = ""


class Band(NamedTuple):
    """The rows of the band; `stopped` is the vehicle state that colours the frame, if any."""

    rows: list[Row]
    stopped: Vehicle | None = None


def stop_band(
    station: Station, since_ns: int | None, keys: BandKeys, width: int, height: int
) -> Band:
    """Return the band of the selected robot, and a row for other robots that have stopped.

    `since_ns` is when the selected robot was first seen in its vehicle state.
    """
    others = other_row(station.roster(), keys, width)
    status: NavigatorStatus | None = live(station.seen(STATUS))
    if status is None:
        return Band(others)
    room = 1 if height < LOW else 3 if height >= TALL else 2
    lost = lost_in(station, status)
    steps = next_steps(status, lost, keys.of, is_placed=not station.place_remedy)
    taken = station.lease.taken
    after = [taken, taken.partition(":")[0]] if taken else forms(steps, keys.where)
    after = after if station.live else [""]
    if is_known(status.vehicle) and Vehicle(status.vehicle) in BAND_ROLES:
        vehicle = Vehicle(status.vehicle)
        heads = heads_of(station, status, since_ns)
        rows = fitted(heads, after, BAND_ROLES[vehicle], width, room)
        return Band(rows + others, vehicle)
    if station.live and lost is not None and awaits(station, status):
        state = "armed" if status.vehicle == Vehicle.ACTIVE else "disarmed"
        return Band(fitted([f"{station.robot} {state}"], after, NEXT_ROLE, width, 1) + others)
    return Band(others)


def is_in_emergency_stop(station: Station) -> bool:
    """Return whether the selected robot shows an emergency stop, or one is being sent to it."""
    status: NavigatorStatus | None = live(station.seen(STATUS))
    shown = status is not None and status.vehicle == Vehicle.EMERGENCY_STOP
    return shown or bool(station.stopping)


def lost_in(station: Station, status: NavigatorStatus) -> LostDrive | None:
    """Return the drive that the selected robot has lost."""
    mission: MissionStatus | None = live(station.seen(MISSION))
    items = enumerate(station.mission_items, start=1)
    places = {(item.number or at) - 1: item for at, item in items}
    return lost_drive(status, mission, places)


def awaits(station: Station, status: NavigatorStatus) -> bool:
    """Return whether the robot stands after a stop that is over, and its drive can go on."""
    mission: MissionStatus | None = live(station.seen(MISSION))
    failed = mission is not None and has_failed(mission) and mission.reason in STOPS
    return status.mode != Mode.MANUAL and (status.goal_reason in STOPS or failed)


def heads_of(station: Station, status: NavigatorStatus, since_ns: int | None) -> list[str]:
    """Return the cause in words, the longest form first."""
    robot = station.robot
    wheels = wheel_words(live(station.seen(ODOMETRY)))
    if status.vehicle == Vehicle.FAILSAFE:
        cause, ago = reason_text(status.vehicle_reason), ago_words(station.now_ns, since_ns)
        return [
            f"FAILSAFE {robot}  {ago}: {cause}{wheels}",
            f"FAILSAFE {robot}: {cause}{wheels}",
            f"FAILSAFE {robot}: {cause}",
            f"FAILSAFE {robot}",
        ]
    stop, acknowledged = station.last_stop(robot), ""
    by = "by another operator"
    if stop is not None and stop.request_id == status.stop_id:
        by, since_ns = "by you", stop.pressed_ns
        if stop.took_ns is not None:
            acknowledged = f", acknowledged in {stop.took_ns / NS_PER_MS:.0f} ms"
    elif stop is not None and status.stop_id in stop.earlier:
        by = "by you"
    ago = ago_words(station.now_ns, since_ns)
    return [
        f"EMERGENCY STOP {robot}  {by} {ago}{acknowledged}{wheels}",
        f"EMERGENCY STOP {robot}  {by} {ago}{wheels}",
        f"EMERGENCY STOP {robot}  {by} {ago}",
        f"EMERGENCY STOP {robot}",
        f"E-STOP {robot}",
    ]


def wheel_words(odometry: PlanarOdometry | None) -> str:
    """Return whether the wheels stand; nothing when it is not known."""
    if odometry is None:
        return ""
    speed_m_s, yaw_rate_rad_s = abs(odometry.speed_m_s), abs(odometry.yaw_rate_rad_s)
    if speed_m_s < STANDING_M_S and yaw_rate_rad_s < STANDING_RAD_S:
        return ", wheels stand"
    return f", still moving at {speed_m_s:.2f} m/s"


def ago_words(now_ns: int, since_ns: int | None) -> str:
    """Return how long ago something was."""
    seconds = 0 if since_ns is None else max(0, now_ns - since_ns) // NS_PER_S
    return f"{seconds} s ago" if seconds < LONG_S else f"{seconds // 60} min ago"


def other_row(roster: Sequence[RosterEntry], keys: BandKeys, width: int) -> list[Row]:
    """Return a row that names the other robots that have stopped; none if no other has."""
    stopped = [
        (entry.robot, Vehicle(status.vehicle), status.vehicle_reason)
        for entry in roster
        if not entry.is_selected
        and entry.status.age is not Age.GONE
        and isinstance(status := entry.status.message, NavigatorStatus)
        and is_known(status.vehicle)
        and Vehicle(status.vehicle) in STOPPED
    ]
    if not stopped:
        return []
    vehicles = [vehicle for _, vehicle, _ in stopped]
    worst = max(vehicles)
    look = f"{keys.of('robot-attention')} select"
    long = ", ".join(
        f"{robot} {STOPPED[vehicle].value}{f': {reason_text(reason)}' if reason else ''}"
        for robot, vehicle, reason in stopped
    )
    short = ", ".join(f"{robot} {STOPPED[vehicle].value}" for robot, vehicle, _ in stopped)
    heads = [long, short, f"{len(stopped)} others stopped"]
    return fitted(heads, [look], BAND_ROLES[worst], width, 1)


def fitted(
    heads: Sequence[str], after: Sequence[str], role: str, width: int, room: int
) -> list[Row]:
    """Return the longest forms that fit into `room` rows: cause, then keys, in one row if wide."""
    for keys in after[:2]:
        gap = width - len(heads[0]) - len(keys) - 2
        if gap >= GAP:
            return [filled(f"{heads[0]}{' ' * gap}{keys}", role, width)]
    inner = max(1, width - 2)
    keys = next((one for one in after if len(one) <= inner), after[-1])
    if room == 1:
        head = next((one for one in heads if len(one) + len(keys) + GAP <= width), heads[-1])
        return [filled(f"{head}  {keys}", role, width)]
    lines = next(
        (lines for head in heads if len(lines := wrap(head, inner)) < room), [heads[-1][:inner]]
    )
    return [filled(line, role, width) for line in (*lines, keys) if line]


def filled(words: str, role: str, width: int) -> Row:
    """Return a row whose colour fills the width."""
    return cut(row(Span(f" {words}".ljust(width), role)), width)
