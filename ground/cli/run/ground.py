"""`ground`: the ground station in a browser, in this terminal, or as lines."""

import argparse

from ground import web
from ground.app.appearance import add_appearance_options
from ground.app.input.keymap import as_toml
from ground.app.start import has_screen, keymap_of
from ground.app.start import run as run_app
from ground.cli.observe.live_line import LiveStatus
from ground.cli.options import common_of
from ground.client.link import Link, open_link
from ground.grammar.words import add_common
from ground.launch.recording_session import (
    RecordingSession,
    add_recording,
    default_folder,
    folder_of,
)
from ground.text.output import Output


def ground_arguments(parser: argparse.ArgumentParser) -> None:
    add_common(parser)
    parser.add_argument(
        "--plain", action="store_true", help="one line a second, as without a terminal"
    )
    add_recording(parser)
    add_appearance_options(parser)
    parser.add_argument("--print-keys", action="store_true", help="print the keys as such a file")
    web.arguments(parser)


def run_ground(options: argparse.Namespace, output: Output) -> int:
    """In a browser, in this terminal, or as lines."""
    if options.print_keys:
        keymap = keymap_of(options)
        found: dict[str, object] = {key.id: list(key.keys) for key in keymap.keys}
        output.result(found, as_toml(keymap))
        return 0
    if options.web is not None:
        return web.serve(options, output)
    with open_link(common_of(options)) as link:
        return act_ground(options, link, output)


def act_ground(options: argparse.Namespace, link: Link, output: Output) -> int:
    """Until the operator leaves: the robot hears its operator, the operator sees the robot."""
    if has_screen() and not (options.plain or options.json):
        return run_recorded(options, link)
    link.bus.announce()
    output.note(f"operator of {link.robot}; Ctrl-C ends the heartbeat, and GUIDED with it")
    LiveStatus(link, output, beats=True).run()
    return 0


def run_recorded(options: argparse.Namespace, link: Link) -> int:
    """The app, and beside it a recorder unless that is refused."""
    common, folder = common_of(options), folder_of(options)
    where = folder or default_folder()
    with RecordingSession(where, common, link.clock, options.config, options.keep) as recording:
        if folder is not None:
            recording.begin()
        return run_app(options, link, common, recording=recording)
