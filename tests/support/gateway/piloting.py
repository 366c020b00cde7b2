"""A bench with all services, and what tests of driving do with it."""

from typing import Any

from gateways.mavlink.services import face_of
from ground.client.operations.session import Operation
from protocol.wire.enums import MissionState, Mode, Vehicle
from tests.support.gateway.fake_port import Bench
from tests.support.gateway.messages import mission_status
from tests.support.gateway.telemetry import everything, odometry, status

LIMITS = {"v_max_m_s": 0.8, "yaw_max_rad_s": 2.0}


def driving_bench(mode: Mode = Mode.HOLD, vehicle: Vehicle = Vehicle.ACTIVE) -> Bench:
    """Return a bench whose robot publishes everything, at (3, 4), looking east."""
    bench = Bench()
    bench.face = face_of(bench.vehicle)
    bench.vehicle.parameters |= LIMITS
    show(bench, mode, vehicle=vehicle)
    return bench


def show(
    bench: Bench,
    mode: Mode = Mode.HOLD,
    mission: MissionState = MissionState.NONE,
    vehicle: Vehicle = Vehicle.ACTIVE,
) -> None:
    """Let the robot publish a state, and a round pass."""
    bench.port.telemetry |= everything() | {
        "status": status(vehicle=vehicle, mode=mode),
        "mission": mission_status(mission),
        "odometry": odometry(heading_rad=0.0),
    }
    bench.after(0.02)


def performed(bench: Bench) -> list[Operation[Any]]:
    """Return the operations since the last call."""
    done = list(bench.port.performed)
    bench.port.performed.clear()
    return done


def accept_all(bench: Bench) -> None:
    """Let the robot accept all that it is asked."""
    while bench.port.waiting:
        bench.port.answer()
