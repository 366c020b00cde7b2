"""`watch` and `ground`: what the robot says in one live line, with a heartbeat or without."""

import argparse
import sys
from collections import deque
from contextlib import suppress
from typing import Final

from ground import web
from ground.app.appearance import add_looks
from ground.app.input.keymap import as_toml
from ground.app.start import has_screen, keymap_of
from ground.app.start import run as run_app
from ground.client.connection import add_common, common_of
from ground.client.link import LISTEN_NS, Link, linked
from ground.client.requests import BEAT_NS, Pace
from ground.client.status_line import watch_line
from ground.client.telemetry import LOOKED_AT, Telemetry
from ground.launch.recording_session import Recording, add_recording, folder_of, usual_folder
from ground.text.output import Says
from ground.text.status_parts import in_words
from ground.text.statustext import Texts, aged
from protocol.topics import HEARTBEAT, STATUS, TEXT
from protocol.wire.codec import decode
from runtime.errors import RemoteError
from runtime.units import NS_PER_S

SILENT_NS: Final = 2_000_000_000
SHOW_NS: Final = 200_000_000
SHOW_PLAIN_NS: Final = 1_000_000_000
MAX_WAITING: Final = 1000
"""Frames of texts kept while the terminal takes no more; the oldest give way."""


def arguments(parser: argparse.ArgumentParser) -> None:
    add_common(parser)
    parser.add_argument("--once", action="store_true", help="look once, as --json does, and end")


def ground_arguments(parser: argparse.ArgumentParser) -> None:
    add_common(parser)
    parser.add_argument(
        "--plain", action="store_true", help="one line a second, as without a terminal"
    )
    add_recording(parser)
    add_looks(parser)
    parser.add_argument("--print-keys", action="store_true", help="print the keys as such a file")
    web.arguments(parser)


def run_ground(options: argparse.Namespace, says: Says) -> int:
    """In a browser, in this terminal, or as lines."""
    if options.print_keys:
        keymap = keymap_of(options)
        found: dict[str, object] = {key.id: list(key.keys) for key in keymap.keys}
        says.result(found, as_toml(keymap))
        return 0
    if options.web is not None:
        return web.serve(options, says)
    with linked(common_of(options)) as link:
        return act_ground(options, link, says)


def act(options: argparse.Namespace, link: Link, says: Says) -> int:
    if options.once or options.json or options.attended:
        with link.hearing(*LOOKED_AT) as telemetry:
            return look_once(link, telemetry, says)
    # What it shows is its result: one line after the other for whoever reads a pipe.
    Lookout(link, Says(as_json=False, err=sys.stdout), beats=False).run()
    return 0


def act_ground(options: argparse.Namespace, link: Link, says: Says) -> int:
    """Until the operator leaves: the robot hears its operator, the operator sees the robot."""
    if has_screen() and not (options.plain or options.json):
        return run_recorded(options, link)
    link.bus.announce()
    says.note(f"operator of {link.robot}; Ctrl-C ends the heartbeat, and GUIDED with it")
    Lookout(link, says, beats=True).run()
    return 0


def run_recorded(options: argparse.Namespace, link: Link) -> int:
    """The app, and beside it a recorder unless that is refused."""
    common, folder = common_of(options), folder_of(options)
    where = folder or usual_folder()
    with Recording(where, common, link.clock, options.config, options.keep) as recording:
        if folder is not None:
            recording.begin()
        return run_app(options, link, common, recording=recording)


def look_once(link: Link, telemetry: Telemetry, says: Says) -> int:
    """0 when the robot's status is there, 1 when nothing is heard of it."""
    link.wait(lambda: all(telemetry.latest(topic) for topic in LOOKED_AT), LISTEN_NS)
    now_ns = link.clock.now_ns()
    heard = telemetry.live(STATUS, now_ns) is not None
    found = snapshot(telemetry, now_ns)
    text = in_words(watch_line(telemetry, now_ns))
    if not heard:
        why = link.diagnosis()
        found |= {"reason": why}
        text = f"{text}\n{why}"
    says.result({"robot": link.robot, "ok": heard, **found}, text)
    return 0 if heard else 1


def snapshot(telemetry: Telemetry, now_ns: int) -> dict[str, object]:
    """Every stream with its age; a value that is too old is null."""
    streams: dict[str, object] = {}
    for topic in LOOKED_AT:
        seen = telemetry.seen(topic, now_ns)
        message = telemetry.live(topic, now_ns)
        names = () if message is None else message.__struct_fields__
        streams[topic.path] = {
            "age_s": None if seen.age_ns is None else seen.age_ns / NS_PER_S,
            "state": seen.age.value,
            "message": {name: getattr(message, name) for name in names} or None,
        }
    return {"streams": streams}


class Lookout:
    """Shows how it stands until a signal ends it; with `beats` it is also the operator."""

    def __init__(self, link: Link, says: Says, *, beats: bool) -> None:
        self._link = link
        self._says = says
        self._beats = beats
        self._telemetry = Telemetry(link.bus, link.robot, notify=link.pulse.beat)
        self._texts = Texts()
        self._frames: deque[tuple[bytes, int]] = deque(maxlen=MAX_WAITING)
        self._pace = Pace()
        self._silent = False
        self._began_ns = link.clock.now_ns()
        link.bus.stream(TEXT, lambda _key, *told: self._frames.append(told), link.robot)

    def run(self) -> None:
        every_ns = SHOW_NS if self._says.live else SHOW_PLAIN_NS
        shown_ns = 0
        if self._beats:
            self._link.beat()
        self._link.wait(lambda: self._telemetry.latest(STATUS) is not None, LISTEN_NS)
        while True:
            now_ns = self._link.clock.now_ns()
            self._tell_texts()
            if self._beats and self._pace.due(now_ns, self._stamp_ns()):
                self._link.beat()
            if now_ns - shown_ns >= every_ns:
                shown_ns = now_ns
                self._says.line(watch_line(self._telemetry, now_ns))
            self._explain_silence(now_ns)
            self._link.pulse.wait_until(now_ns + BEAT_NS // 2)

    def _explain_silence(self, now_ns: int) -> None:
        """Once for each silence: is nobody there, or does somebody hang?"""
        heard = self._telemetry.latest(HEARTBEAT)
        silent = now_ns - (self._began_ns if heard is None else heard[1]) > SILENT_NS
        if silent and not self._silent:
            self._says.note(self._link.diagnosis())
        self._silent = silent

    def _stamp_ns(self) -> int:
        newest = self._telemetry.latest(STATUS)
        return 0 if newest is None else newest[0].time_ns

    def _tell_texts(self) -> None:
        while self._frames:
            with suppress(RemoteError):
                frame, told_ns = self._frames.popleft()
                text = self._texts.receive(decode(frame).message)
                if text:
                    words = aged(text, self._link.clock.now_ns() - told_ns)
                    self._says.note(f"{self._link.robot}: {words}")
