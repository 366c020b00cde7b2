"""State of the firmware besides that of the core, and the inputs of a tick from its messages."""

from struct import unpack_from
from typing import Final

import board
import wire

from robot.core import reasons
from robot.core.parameters import DEFAULTS
from robot.core.values import Inputs, scan_of, twist_of, wheels_of

NEVER: Final = 0xFFFFFFFF
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


def read_inputs(onboard: Onboard) -> Inputs:
    """Return the inputs of the core; a sample that did not arrive counts as missing."""
    (
        stamp,
        now_ms,
        number,
        wheels_seq,
        scan_seq,
        _,
        scan_age_ms,
        operator_age_ms,
        speed_mm_s,
        yaw_rate_mrad_s,
        flags,
    ) = unpack_from(wire.TICK_INPUTS_FORMAT, board.inbox)
    state, wheels, scan = onboard.state, None, None
    onboard.stamp, onboard.now_ms, onboard.tick = stamp, now_ms, number
    onboard.sense_seq = scan_seq
    if flags & wire.INPUT_WHEELS and onboard.wheels and onboard.wheels.seq == wheels_seq:
        wheels = wheels_of(onboard.wheels)
    if flags & wire.INPUT_SCAN and onboard.scan and onboard.scan.seq == scan_seq:
        scan = scan_of(onboard.scan, scan_age_ms)
    if flags & wire.INPUT_BUDGET:
        state.reported = reasons.BUDGET
    if flags & wire.INPUT_NAME_TAKEN:
        state.reported = reasons.NAME_TAKEN
    onboard.steered = flags & wire.INPUT_TELEOP != 0
    state.manual = twist_of(speed_mm_s, yaw_rate_mrad_s) if onboard.steered else None
    age_ms = None if operator_age_ms == NEVER else operator_age_ms
    return Inputs(now_ms, wheels, scan, age_ms)
