"""Main loop of the firmware: a tick for each TICK_INPUTS, an answer for each request."""

import gc
from typing import Final

import board
import outputs
import requests
import wire
from onboard import Onboard, read_inputs

from robot.core import brain, reasons
from robot.core.safety import failsafe

HELLO_MS: Final = 1000
IDLE_MS: Final = 50
CLOCK_MASK: Final = 0x3FFFFFFF


def say_hello(onboard: Onboard) -> None:
    """Repeat BOARD_HELLO until the host has set up the core."""
    while onboard.state is None:
        outputs.send_hello(onboard)
        started = board.clock()
        while board.clock() - started & CLOCK_MASK < HELLO_MS * 25000 and onboard.state is None:
            receive(onboard, board.receive(HELLO_MS))


def receive(onboard: Onboard, message_id: int) -> None:
    """Act on one message; 0 is none."""
    if message_id == wire.TICK_INPUTS_ID:
        tick(onboard)
    elif message_id == wire.WHEEL_TICKS_ID:
        onboard.wheels = wire.wheel_ticks(board.inbox)
    elif message_id == wire.SONAR_SCAN_ID:
        onboard.scan = wire.sonar_scan(board.inbox)
    elif message_id == wire.BOARD_RESTART_ID:
        requests.restart()
    elif message_id:
        requests.handle(onboard, message_id)


def tick(onboard: Onboard) -> None:
    """Run one cycle of the core, send its outputs, then collect the garbage."""
    if onboard.state is None:
        return
    started = board.clock()
    given = read_inputs(onboard)
    try:
        _, chosen = brain.step(onboard.state, given, onboard.params)
        left_mrad_s, right_mrad_s = chosen.left_mrad_s, chosen.right_mrad_s
    except Exception:
        failsafe.trip(onboard.state.machine, reasons.CORE_EXCEPTION, onboard.now_ms)
        chosen, left_mrad_s, right_mrad_s = None, 0, 0
    outputs.send_command(onboard, left_mrad_s, right_mrad_s)
    command_clocks = board.clock() - started & CLOCK_MASK
    outputs.send_tick(onboard, chosen)
    used = board.heap_used()
    outputs.send_report(onboard, command_clocks, used)
    gc.collect()
    onboard.live = board.heap_used()


def watch(onboard: Onboard, idle_ms: int) -> None:
    """Stop the wheels if the host has been silent for too long."""
    if not onboard.silence_ms or idle_ms < onboard.silence_ms:
        return
    if not onboard.silent:
        onboard.silent = True
        onboard.silences += 1
        failsafe.trip(onboard.state.machine, reasons.TICKS_LOST, onboard.now_ms)
        outputs.send_state(onboard)
    outputs.send_command(onboard, 0, 0)


def run() -> None:
    """Set up the firmware, then process messages for ever."""
    board.settle()
    onboard = Onboard()
    say_hello(onboard)
    idle_ms = 0
    while True:
        message_id = board.receive(IDLE_MS)
        if message_id == wire.TICK_INPUTS_ID:
            idle_ms, onboard.silent = 0, False
        elif not message_id:
            idle_ms += IDLE_MS
            watch(onboard, idle_ms)
        receive(onboard, message_id)


run()
