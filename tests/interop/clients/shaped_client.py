"""A client that is only known from its source: a script of steps, executed with pymavlink.

Each action in `shaped/*.toml` names the file of the client in which its sequence was read. The
retries and times of an action are those of the client. When the client gives up, its user tries
again: a line that loses every fifth message loses four commands in a row in one of 600 cases.
"""

import argparse
import sys
import time
import tomllib
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any, Final

from pymavlink import mavftp

from tests.interop.clients.pilot import Pilot, item, mavlink
from tests.interop.clients.steps import (
    Call,
    Place,
    StepError,
    Steps,
    called,
    fence,
    goal,
    repeat,
    route,
)

SCRIPTS: Final = Path(__file__).parents[1] / "shaped"
FENCE: Final = mavlink.MAV_MISSION_TYPE_FENCE
CORNER: Final = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
BY_NAME: Final = {cls.msgname: cls for cls in mavlink.mavlink_map.values()}
TARGET: Final = {"target_system": 1, "target_component": 1, "target": 1}
FEW: Final = 4
USER_S: Final = 90.0
"""The user repeats an action until this time has passed."""
TRIED_AGAIN: Final = frozenset({"exchange", "parameters", "file", "download"})

Action = Mapping[str, Any]


class Script:
    """The state of a run: the connection, where the robot started, and the parameters."""

    def __init__(self, pilot: Pilot, call: Call, note: Callable[[str], None]) -> None:
        self.pilot = pilot
        self.note = note
        self.call = call
        self.start: Place | None = None
        self.indexes: set[int] = set()
        self.kinds: dict[str, Callable[[Action], None]] = {
            "wait": self.wait,
            "exchange": self.exchange,
            "parameters": self.parameters,
            "file": self.file,
            "upload": self.upload,
            "download": self.download,
            "arrive": self.arrive,
            "log": self.log,
        }

    def run(self, action: Action) -> None:
        """Carry out one action; a failure names where its sequence was read."""
        deadline_s = time.monotonic() + USER_S
        while True:
            try:
                self.kinds[action["kind"]](action)
            except StepError as error:
                if action["kind"] not in TRIED_AGAIN or time.monotonic() >= deadline_s:
                    raise StepError(f"{action['read']} ({action['source']}): {error}") from None
                self.note(f"tried again: {action['read']}")
            else:
                return

    def wait(self, action: Action) -> None:
        """Wait for so many messages that match."""
        found: list[Any] = []
        self.pilot.handlers[action["message"]] = found.append
        try:
            what = f"{action['count']} of {action['message']}"
            self.pilot.until(
                lambda: sum(matches(one, action) for one in found) >= action["count"],
                what,
                action["within_s"],
            )
        finally:
            self.pilot.handlers.clear()

    def exchange(self, action: Action) -> None:
        """Send messages, again until each expected one has come."""
        found: list[Any] = []
        for wanted in action["expect"]:
            self.pilot.handlers[wanted["message"]] = found.append

        def is_answered() -> bool:
            return all(any(matches(one, each) for one in found) for each in action["expect"])

        try:
            self._repeat(action, partial(self.send, action), is_answered, f"{action['expect']}")
        except StepError as error:
            raise StepError(f"{error}; answers: {found[-FEW:]}") from None
        finally:
            self.pilot.handlers.clear()

    def parameters(self, action: Action) -> None:
        """Read all parameters; ask for those that are missing one by one."""
        count = 0
        self.indexes = set()

        def take(message: Any) -> None:
            nonlocal count
            count = message.param_count
            if message.param_index < count:
                self.indexes.add(message.param_index)

        def ask() -> None:
            if len(self.indexes) < count * action["whole_below"] or not count:
                self.pilot.mav.param_request_list_send(1, 1)
                return
            missing = [one for one in range(count) if one not in self.indexes]
            for index in missing[: action["at_once"]]:
                self.pilot.mav.param_request_read_send(1, 1, b"", index)

        self.pilot.handlers["PARAM_VALUE"] = take
        try:
            self._repeat(action, ask, lambda: count and len(self.indexes) == count, "parameters")
        finally:
            self.pilot.handlers.clear()

    def file(self, action: Action) -> None:
        """Read a file by FTP; a request without an answer has been silent for `again_s`.

        pymavlink waits longer by itself for what it does not repeat: the first and the last reply.
        """
        got: list[bytes] = []
        again_s, block_bytes = action["again_s"], action["block_bytes"]
        settings = mavftp.MAVFTPSettings(
            [
                *((name, int, 0) for name in ("debug", "pkt_loss_tx", "pkt_loss_rx")),
                *((name, int, 5) for name in ("max_backlog", "write_qsize")),
                *((name, int, block_bytes) for name in ("burst_read_size", "write_size")),
                ("idle_detection_time", float, again_s + 0.1),
                ("read_retry_time", float, again_s),
                ("retry_time", float, again_s),
            ]
        )
        client = mavftp.MAVFTP(self.pilot.link, 1, 1, settings)

        def keep(read: Any) -> None:
            if read is not None:  # it is None after a failure
                got.append(read.read())

        def ask() -> None:
            client.cmd_get([action["path"]], callback=keep)
            client.process_ftp_reply("OpenFileRO", timeout=action["every_s"])

        self._repeat(action, ask, lambda: got and got[0], action["path"])

    def upload(self, action: Action) -> None:
        """Upload the mission or the fence."""
        if action["what"] == "fence":
            corners = fence(self.position())
            made = partial(item, command=CORNER, param1=float(len(corners)), mission_type=FENCE)
            self.pilot.upload([made(*pair) for pair in enumerate(corners)], FENCE)
            return
        places = [self.position(), *route(self.position())]
        items = [item(*pair) for pair in enumerate(places)]
        self.pilot.upload([as_float(one) for one in items] if action["float"] else items, 0)

    def download(self, action: Action) -> None:
        """Download a list: each item is asked for until it comes."""
        pilot, kind = self.pilot, action["mission_type"]
        counts: list[int] = []
        found: dict[int, Any] = {}
        count_of = lambda m: counts.append(m.count) if m.mission_type == kind else None  # noqa: E731
        keep = lambda m: found.update({m.seq: m}) if m.mission_type == kind else None  # noqa: E731
        pilot.handlers |= {
            "MISSION_COUNT": count_of,
            "MISSION_ITEM_INT": keep,
            "MISSION_ITEM": keep,
        }
        request = pilot.mav.mission_request_send
        if action["request"] == "MISSION_REQUEST_INT":
            request = pilot.mav.mission_request_int_send
        try:
            ask = partial(pilot.mav.mission_request_list_send, 1, 1, kind)
            self._repeat(action, ask, lambda: counts, "MISSION_COUNT")
            for seq in range(counts[0]):
                one = partial(request, 1, 1, seq, kind)
                self._repeat(action["item"], one, partial(found.__contains__, seq), f"item {seq}")
        finally:
            pilot.handlers.clear()
        pilot.mav.mission_ack_send(1, 1, mavlink.MAV_MISSION_ACCEPTED, kind)
        if counts[0] < action.get("at_least", 0):
            raise StepError(f"the list has {counts[0]} items")

    def arrive(self, action: Action) -> None:
        """Wait until the robot is where it should be, or stands; meanwhile stream setpoints."""
        start = self.position()
        conditions: dict[str, Callable[[], object]] = {
            "under way": lambda: self.pilot.place.distance_m(start) > 0.3,
            "standing": lambda: self.pilot.speed_m_s < 0.01,
            "end of route": lambda: self.pilot.is_at(route(start)[-1]),
            "goal": lambda: self.pilot.is_at(goal(start)),
        }
        within_s = action["within_s"]
        every_s = action.get("every_s", within_s)
        times = {"every_s": every_s, "tries": within_s / every_s}
        self._repeat(times, partial(self.send, action), conditions[action["where"]], "arrival")

    def log(self, action: Action) -> None:
        """Download the newest log."""
        path = self.call.folder / "downloaded.tlog"
        self.pilot.download_log(path)
        self.call.require_recording(path)

    def send(self, action: Action) -> None:
        """Send the messages of an action."""
        for one in action.get("send", ()):
            self.pilot.mav.send(self.message(one))

    def message(self, fields: Mapping[str, Any]) -> Any:
        """Return a message; fields that are not given are 0, or name this vehicle."""
        cls = BY_NAME[fields["message"]]
        values: dict[str, Any] = {}
        for name, kind, length in zip(
            cls.fieldnames, cls.fieldtypes, ordered_lengths(cls), strict=True
        ):
            zero: Any = b"" if kind == "char" else [0] * length if length else 0
            values[name] = TARGET.get(name, zero)
        given = {name: value for name, value in fields.items() if name != "message"}
        unknown = given.keys() - values.keys()
        if unknown:
            raise StepError(f"{fields['message']} has no {sorted(unknown)}")
        return cls(**values | {name: self.value(value) for name, value in given.items()})

    def value(self, value: Any) -> Any:
        """Return a value of a script: `goal.latitude` and `goal.longitude` are places."""
        if isinstance(value, str) and value.startswith("goal."):
            return round(getattr(goal(self.position()), value.removeprefix("goal.")) * 1e7)
        return value.encode() if isinstance(value, str) else value

    def position(self) -> Place:
        """Return where the robot stood when it was first seen."""
        if self.start is None:
            self.pilot.until(
                lambda: "GLOBAL_POSITION_INT" in self.pilot.newest, "GLOBAL_POSITION_INT"
            )
            self.start = self.pilot.place
        return self.start

    def _repeat(
        self,
        action: Action,
        act: Callable[[], object],
        condition: Callable[[], object],
        what: str,
    ) -> None:
        every_s = action["every_s"]
        try:
            repeat(
                act,
                condition,
                what,
                every_s=every_s,
                within_s=every_s * action["tries"],
                look=self.pilot.look,
            )
        except StepError as error:
            raise StepError(f"{error}; {self.pilot.seen()}") from None


def matches(message: Any, wanted: Mapping[str, Any]) -> bool:
    """Return whether a message has the values and bits of an expectation."""
    if message.get_type() != wanted["message"]:
        return False
    values, bits = wanted.get("where", {}), wanted.get("bits", {})
    return all(getattr(message, name) == value for name, value in values.items()) and all(
        getattr(message, name) & mask == mask for name, mask in bits.items()
    )


def ordered_lengths(cls: Any) -> list[int]:
    """Return the array lengths of a message's fields, in the order of the constructor."""
    by_name = dict(zip(cls.ordered_fieldnames, cls.array_lengths, strict=True))
    return [by_name[name] for name in cls.fieldnames]


def as_float(one: Any) -> Any:
    """Return a MISSION_ITEM for a MISSION_ITEM_INT."""
    fields = {name: getattr(one, name) for name in one.fieldnames}
    fields |= {"x": one.x / 1e7, "y": one.y / 1e7}
    return mavlink.MAVLink_mission_item_message(**fields)


def main() -> None:
    """Run the script that is named first."""
    parser = argparse.ArgumentParser(add_help=False)
    parser.add_argument("script")
    named, rest = parser.parse_known_args()
    sys.argv[1:] = rest
    text = (SCRIPTS / f"{named.script}.toml").read_text(encoding="utf-8")
    script = tomllib.loads(text)
    call, steps = called(), Steps(script["client"])
    pilot = Pilot(call.endpoint)
    run = Script(pilot, call, steps.note)
    for step in script["steps"]:
        with steps.step(step["name"], is_needed=step["name"] == "connect"):
            for action in step["actions"]:
                run.run(action)
    steps.end()


if __name__ == "__main__":
    main()
