"""State of the firmware besides that of the core."""

from typing import Final

from robot.core.parameters import DEFAULTS

SILENCE_MS: Final = 150


class Onboard:
    """The core and its newest sensor messages; `state` is None until BOARD_SETUP.

    `stamp` are the bytes of the stamp of the last tick, which is copied to the outputs. `live` and
    `peak` are bytes of the heap.
    """

    def __init__(self) -> None:
        self.params = DEFAULTS
        self.state = None
        self.wheels = None
        self.scan = None
        self.stamp = bytes(8)
        self.now_ms = 0
        self.tick = 0
        self.sense_seq = 0
        self.commands = 0
        self.requests = 0
        self.silence_ms = SILENCE_MS
        self.silent = False
        self.silences = 0
        self.steered = False
        self.live = 0
        self.peak = 0
        self.busy = 0
