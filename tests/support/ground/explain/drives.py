"""Real drives of every navigator, as the messages that a ground station would have got."""

from typing import NamedTuple

from plant.sim.simulation import Plant
from plant.world.file import load
from protocol.wire.messages import AvoidanceDecision, NavigatorStatus
from robot import telemetry
from robot.core.values import Outputs
from robot.vehicle import Vehicle
from study.trial.core_loop import CoreLoop
from study.trial.trial import Trial, run_trial

WORLDS = ("box", "u_trap", "forest_medium")
TIMEOUT_S = 60.0


class Moment(NamedTuple):
    """One tick; `yaw_rate_rad_s` is what the wheels made of it until the next one."""

    decision: AvoidanceDecision
    status: NavigatorStatus
    yaw_rate_rad_s: float


class Recording:
    """Observes a trial and stores what the robot would have published."""

    def __init__(self) -> None:
        self._told: list[tuple[AvoidanceDecision, NavigatorStatus]] = []
        self._yaw_rates: list[float] = []

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        state, now_ns = onboard.state, plant.now_ns
        zone_m = Vehicle.zone_m.fget(onboard)  # type: ignore[attr-defined]
        self._told.append(
            (
                telemetry.decision(outputs, zone_m, now_ns),
                telemetry.status(state, 1, now_ns, onboard.now_ms),
            )
        )
        self._yaw_rates.append(plant.truth().yaw_rate_rad_s)

    def moments(self) -> list[Moment]:
        """Return all ticks but the last, whose successor is unknown."""
        return [
            Moment(*told, yaw) for told, yaw in zip(self._told, self._yaw_rates[1:], strict=False)
        ]


def drive(world: str, navigator: str, noise: str = "none") -> list[Moment]:
    recording = Recording()
    trial = Trial(world=load(world), navigator=navigator, noise=noise, timeout_s=TIMEOUT_S)
    run_trial(trial, recording)
    return recording.moments()
