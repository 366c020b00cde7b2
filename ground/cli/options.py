"""Network and robot, from the parsed arguments of a verb and from what runs here."""

import argparse
from dataclasses import replace
from pathlib import Path

from ground.client.connection import Common, Config, common
from ground.commands.command import Reach
from ground.text.output import Output
from protocol.bus.network import Network
from protocol.options import usual_endpoint
from runtime.config import load_shared


def common_of(options: argparse.Namespace | Reach, output: Output | None = None) -> Common:
    """Merge defaults, the file and the command line; UserError or ConfigError for a bad value.

    With an output, print which run the endpoint was taken from.
    """
    found = common(options.connect, options.id, options.config, options.run, options.context)
    if output is not None and found.source:
        output.note(found.source)
    return found


def listening_of(options: argparse.Namespace) -> Network:
    """Return the network of a process that routes for others."""
    config = Config() if options.config is None else load_shared(Path(options.config), Config)
    network = config.network or Network()
    listen = network.listen or (usual_endpoint(network),)
    if options.listen is not None:
        listen = (options.listen,)
    connect = network.connect if options.connect is None else (options.connect,)
    return replace(network, mode="router", listen=listen, connect=connect)
