"""Wheel commands, and a gate that has been sent ticks, as the tests of both use them."""

from plant.process.robot_link import CommandGate, WheelOutput
from protocol.wire.limits import MAX_WHEEL_TTL_MS
from protocol.wire.messages import WheelCommand
from runtime.units import UINT32

FAST = 9000


def command(
    sense_seq: int,
    *,
    seq: int = 1,
    mrad_s: int = FAST,
    ttl_ms: int = MAX_WHEEL_TTL_MS,
    epoch: int = 0,
) -> WheelCommand:
    return WheelCommand(
        time_ns=0,
        seq=seq,
        sense_seq=sense_seq & UINT32,
        epoch=epoch,
        left_mrad_s=mrad_s,
        right_mrad_s=mrad_s,
        ttl_ms=ttl_ms,
    )


def gate_at(tick: int, first: int = 0) -> CommandGate:
    """Return a plant that has sent all ticks from the first one."""
    gate = CommandGate()
    for sent in range(first, tick + 1):
        gate.begin_tick(sent)
    return gate


def taken(gate: CommandGate, *commands: WheelCommand) -> WheelOutput | None:
    for one in commands:
        gate.receive(one)
    return gate.take()
