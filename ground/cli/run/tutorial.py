"""`tutorial`: a first drive with a guide on the screen; without a terminal, its steps as text."""

import argparse

from ground.app.chrome.tutorial import outline
from ground.app.input.keymap import Keymap, shown
from ground.app.start import has_screen
from ground.cli.run import up
from ground.text.output import Output


def arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `up`, which the tutorial runs."""
    up.arguments(parser)
    parser.set_defaults(lessons=True)


def run(options: argparse.Namespace, output: Output) -> int:
    """Run `up` with the guide; without a terminal, print the steps and return 0."""
    if has_screen() and not (options.headless or options.json):
        return up.run(options, output)
    keymap = Keymap()
    steps = list(outline(lambda id: shown(keymap[id].keys[:1])))
    lead = "sidestep tutorial guides through these steps on a terminal:"
    output.result({"steps": steps}, "\n".join([lead, *steps]))
    return 0
