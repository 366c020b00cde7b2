"""`ground`: the ground station in a browser, in this terminal, or as lines."""

import argparse

from ground import web
from ground.app.appearance import add_appearance_options
from ground.app.input.keymap import as_toml
from ground.app.start import has_screen, keymap_of
from ground.app.start import run as run_app
from ground.cli.observe.live_line import show_status
from ground.cli.options import common_of
from ground.client.robot_link import RobotLink, open_link
from ground.client.stop_ways import StopServer
from ground.commands.command import add_common
from ground.launch.recording_session import (
    RecordingSession,
    add_recording,
    folder_of,
)
from ground.text.output import Output
from ground.user.folders import recordings_folder
from ground.user.settings import load_settings


def ground_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `ground`."""
    add_common(parser)
    parser.add_argument(
        "--plain",
        action="store_true",
        help="lines for a screen reader: at each change of state, else every 10 s",
    )
    add_recording(parser)
    add_appearance_options(parser)
    parser.add_argument("--print-keys", action="store_true", help="print the keys as a key file")
    web.arguments(parser)


def run_ground(options: argparse.Namespace, output: Output) -> int:
    """Run the station in a browser, in this terminal, or as lines."""
    if options.print_keys:
        keymap = keymap_of(options, load_settings())
        found: dict[str, object] = {key.id: list(key.keys) for key in keymap.keys}
        output.result(found, as_toml(keymap))
        return 0
    if options.web is not None:
        return web.serve(options, output)
    with open_link(common_of(options, output)) as link:
        return act_ground(options, link, output)


def act_ground(options: argparse.Namespace, link: RobotLink, output: Output) -> int:
    """Run the station over a link until the operator leaves, with the operator's heartbeat."""
    if has_screen() and not (options.plain or options.json):
        with StopServer(link):
            return run_recorded(options, link)
    link.bus.announce()
    output.note(f"operator of {link.name}; Ctrl-C ends the heartbeat, and a robot in GUIDED stops")
    with StopServer(link):
        show_status(link, output, beats=True, spoken=options.plain)
    return 0


def run_recorded(options: argparse.Namespace, link: RobotLink) -> int:
    """Run the app, with a recorder beside it unless --no-record is given."""
    common, folder = link.common, folder_of(options)
    where = folder or recordings_folder()
    with RecordingSession(where, common, link.clock, common.config, options.keep) as recording:
        if folder is not None:
            recording.begin()
        return run_app(options, link.bus, common, recording=recording)
