"""A client of the mission protocol: upload and download plans like the named clients."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from runtime.units import NS_PER_S
from vehicle_check.dialect import mavlink
from vehicle_check.session import Client, Frame

MISSION: Final = mavlink.MAV_MISSION_TYPE_MISSION
FENCE: Final = mavlink.MAV_MISSION_TYPE_FENCE
RALLY: Final = mavlink.MAV_MISSION_TYPE_RALLY
REQUESTS: Final = ("MISSION_REQUEST", "MISSION_REQUEST_INT")
DEGREES_E7: Final = 1e7
MAX_ITEMS: Final = 2_000
ANSWER_S: Final = 1.0
QUIET_TWICE: Final = 2
UPLOAD_S: Final = 6.0
UPLOAD_WITH_LOSS_S: Final = 30.0
RELATIVE: Final = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT


class Item(NamedTuple):
    """One item of a plan; `x` and `y` are latitude and longitude in 1e-7 degrees."""

    command: int
    x: int
    y: int
    frame: int = RELATIVE
    params: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    z: float = 0.0


@dataclass
class Upload:
    """The result of an upload."""

    result: int | None = None
    opaque_id: int = 0
    requests: list[tuple[str, int]] = field(default_factory=list)
    may_be_old: bool = False
    """True on a lossy line: a vehicle may send the result of an earlier upload again."""
    is_first: bool = True
    """True until a refusal has been ignored as such a copy."""


def message_of(
    client: Client, item: Item, seq: int, kind: int, *, as_float: bool = False, current: int = 0
) -> Any:
    """Return MISSION_ITEM_INT, or MISSION_ITEM."""
    station = client.station
    head = (*station.address, seq, item.frame, item.command, current, 1)
    if as_float:
        place = (item.x / DEGREES_E7, item.y / DEGREES_E7, item.z)
        return mavlink.MAVLink_mission_item_message(*head, *item.params, *place, kind)
    place = (item.x, item.y, item.z)
    return mavlink.MAVLink_mission_item_int_message(*head, *item.params, *place, kind)


def count_message(client: Client, count: int, kind: int) -> Any:
    """Return MISSION_COUNT."""
    station = client.station
    return mavlink.MAVLink_mission_count_message(*station.address, count, kind)


def upload(
    client: Client,
    items: Sequence[Item],
    kind: int = MISSION,
    *,
    as_float: bool = False,
    ignored: int | None = None,
) -> Upload:
    """Send a plan as the vehicle requests it; the first request for item `ignored` is not answered.

    The result is that of MISSION_ACK, None without one. With loss the announcement and the last
    item are sent again, as MAVSDK and MAVProxy do.
    """
    station, found = client.station, Upload(may_be_old=client.station.is_lossy)
    within_s = UPLOAD_WITH_LOSS_S if station.is_lossy else UPLOAD_S
    end_ns = station.now_ns + round(within_s * NS_PER_S)
    since, quiet, last = client.mark(), 0, len(items) - 1

    def send(seq: int) -> None:
        if seq <= last:
            client.send(message_of(client, items[seq], seq, kind, as_float=as_float))

    client.send(count_message(client, len(items), kind))
    while station.now_ns < end_ns and found.result is None:
        heard = station.wait(ANSWER_S, lambda: _has_traffic(client, since, kind))  # noqa: B023
        quiet = 0 if heard else quiet + 1
        if not heard and not found.requests:
            client.send(count_message(client, len(items), kind))
        elif not heard and station.is_lossy:
            # A vehicle asks for an item again by itself, but not behind the last one.
            asked = found.requests[-1][1]
            if asked != ignored and (asked == last or quiet >= QUIET_TWICE):
                send(asked)
        elif not heard and ignored is None:
            break
        taken, since = client.log[since:], client.mark()
        for seq in _taken(found, _of_kind(taken, kind), last, ignored):
            send(seq)
    return found


def _taken(found: Upload, frames: Sequence[Frame], last: int, ignored: int | None) -> list[int]:
    """Note what the vehicle has sent; return the items to send, without one to ignore once."""
    wanted = []
    for one in frames:
        if one.name in REQUESTS:
            seq = int(one.message.seq)
            if seq != ignored or seq in [at for _, at in found.requests]:
                wanted.append(seq)
            found.requests.append((one.name, seq))
        elif one.name == "MISSION_ACK" and _is_old(found, one, last):
            found.is_first = False
        elif one.name == "MISSION_ACK":
            found.result, found.opaque_id = int(one.message.type), int(one.message.opaque_id)
    return wanted


def _is_old(found: Upload, ack: Frame, last: int) -> bool:
    """Return whether an acknowledgement is a copy of that of an earlier upload.

    An acceptance before the last item was requested is one, and so may be a first refusal.
    """
    if not found.may_be_old:
        return False
    if ack.message.type == mavlink.MAV_MISSION_ACCEPTED:
        return last not in [seq for _, seq in found.requests]
    return found.is_first and not found.requests


def _of_kind(frames: Sequence[Frame], kind: int) -> list[Frame]:
    """Return the frames of one kind of plan that have reached the ground station."""
    return [
        one for one in frames if not one.is_lost and getattr(one.message, "mission_type", 0) == kind
    ]


def _has_traffic(client: Client, since: int, kind: int) -> bool:
    names = (*REQUESTS, "MISSION_ACK")
    return any(one.name in names for one in _of_kind(client.log[since:], kind))


class Download(NamedTuple):
    """A plan of the vehicle."""

    items: list[Item]
    opaque_id: int
    names: list[str]


def download(client: Client, kind: int = MISSION, *, as_float: bool = False) -> Download | None:
    """Download a plan; None if the vehicle does not send it."""
    station = client.station
    target = station.address
    ask = mavlink.MAVLink_mission_request_list_message(*target, kind)
    count = client.ask(ask, "MISSION_COUNT", lambda one: one.mission_type == kind, ANSWER_S)
    if count is None or count.message.count > MAX_ITEMS:
        return None
    items, names = [], []
    name = "MISSION_ITEM" if as_float else "MISSION_ITEM_INT"
    request = "mission_request" if as_float else "mission_request_int"
    make = getattr(mavlink, f"MAVLink_{request}_message")
    for seq in range(count.message.count):
        answer = client.ask(make(*target, seq, kind), name, _numbered(seq), ANSWER_S)
        if answer is None:
            return None
        one = answer.message
        scale = DEGREES_E7 if as_float else 1
        params = (one.param1, one.param2, one.param3, one.param4)
        place = round(one.x * scale), round(one.y * scale)
        items.append(Item(one.command, *place, one.frame, params, one.z))
        names.append(answer.name)
    client.send(mavlink.MAVLink_mission_ack_message(*target, 0, kind))
    return Download(items, int(count.message.opaque_id), names)


def _numbered(seq: int) -> Any:
    return lambda one: one.seq == seq


def clear(client: Client, kind: int) -> int | None:
    """Delete a plan; return the result of MISSION_ACK."""
    station = client.station
    target = station.address
    message = mavlink.MAVLink_mission_clear_all_message(*target, kind)
    found = client.ask(message, "MISSION_ACK", lambda one: one.mission_type == kind, 2.0)
    return None if found is None else int(found.message.type)
