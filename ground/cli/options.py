"""Network and robot, from the parsed arguments of a verb and from what runs here."""

import argparse
from dataclasses import replace
from pathlib import Path
from threading import Thread

from ground.client.connection import UP_HINT, Common, Config, common
from ground.commands.command import Reach
from ground.text.output import Output
from protocol.bus.network import Hub, Network
from protocol.bus.session import probed
from protocol.options import usual_endpoint
from runtime.config import load_shared


def common_of(options: argparse.Namespace | Reach, output: Output | None = None) -> Common:
    """Merge defaults, the file and the command line; UserError or ConfigError for a bad value.

    With an output, print which run the endpoint was taken from, and at once if no process listens
    there: to dial takes longer.
    """
    found = common(options.connect, options.id, options.config, options.run, options.context)
    if output is not None:
        if found.source:
            output.note(found.source)
        Thread(target=note_absence, args=(found, output), name="note absence", daemon=True).start()
    return found


def note_absence(found: Common, output: Output) -> None:
    """Print that no process listens at any endpoint, if each refuses a connection."""
    if all(probed(endpoint) is Hub.ENDED for endpoint in found.network.connect):
        output.note(f"no process listens at {found.endpoint}: trying; {UP_HINT}")


def listening_of(options: argparse.Namespace) -> Network:
    """Return the network of a process that routes for others."""
    config = Config() if options.config is None else load_shared(Path(options.config), Config)
    network = config.network or Network()
    listen = network.listen or (usual_endpoint(network),)
    if options.listen is not None:
        listen = (options.listen,)
    connect = network.connect if options.connect is None else (options.connect,)
    return replace(network, mode="router", listen=listen, connect=connect)
