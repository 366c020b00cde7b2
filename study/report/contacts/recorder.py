"""Run a trial again and keep the seconds before its contact: poses, decisions, echoes, memory."""

from collections import deque
from dataclasses import dataclass, field
from itertools import takewhile
from typing import Final, NamedTuple

from plant.sim.simulation import Plant
from protocol.outcome import Outcome
from robot.core.perception.echoes import SURE, Echoes
from robot.core.values import Outputs, Pose
from runtime.units import NS_PER_S
from study.trial.core_loop import CoreLoop
from study.trial.trial import Trial, run_trial

KEPT_TICKS: Final = 200
"""Ten seconds."""

MM_PER_M: Final = 1000.0


class StoredPoint(NamedTuple):
    """A remembered echo in the odometry frame; `counts`: the navigator keeps clear of it."""

    x_m: float
    y_m: float
    counts: bool


class Tick(NamedTuple):
    """One tick: `clearance_m` is true, `range_m` are the sonars' ranges from the rim."""

    time_s: float
    true: Pose
    estimated: Pose
    clearance_m: float
    branch: int
    guard: int
    speed_m_s: float
    yaw_rate_rad_s: float
    range_m: tuple[float | None, ...]
    points: tuple[StoredPoint, ...]


@dataclass(slots=True)
class ContactRecorder:
    """Keep the last ticks of a trial."""

    ticks: deque[Tick] = field(default_factory=lambda: deque(maxlen=KEPT_TICKS))

    def __call__(self, plant: Plant, onboard: CoreLoop, outputs: Outputs) -> None:
        """Keep one tick."""
        truth, state = plant.truth(), onboard.state
        self.ticks.append(
            Tick(
                time_s=plant.now_ns / NS_PER_S,
                true=Pose(truth.x_m, truth.y_m, truth.heading_rad),
                estimated=state.odometry.pose,
                clearance_m=plant.attitude()[1],
                branch=0 if outputs.decision is None else outputs.decision.branch,
                guard=outputs.guard,
                speed_m_s=outputs.twist.speed_m_s,
                yaw_rate_rad_s=outputs.twist.yaw_rate_rad_s,
                range_m=tuple(state.ring.range_m),
                points=points_of(getattr(state.memory, "echoes", None)),
            )
        )


def points_of(echoes: Echoes | None) -> tuple[StoredPoint, ...]:
    """Return the remembered echoes; none of a navigator without a memory."""
    if echoes is None:
        return ()
    return tuple(
        StoredPoint(
            echoes.x_mm[index] / MM_PER_M,
            echoes.y_mm[index] / MM_PER_M,
            echoes.weight[index] >= SURE,
        )
        for index in range(echoes.count)
    )


def before_contact(trial: Trial) -> tuple[list[Tick], Outcome]:
    """Return the last ticks of a trial, up to the one of its contact, and its outcome.

    A contact ends the drive. If no kept tick touches anything, the last one counts as the contact.
    """
    recorder = ContactRecorder()
    outcome = run_trial(trial, recorder)
    ticks = list(recorder.ticks)
    apart = len(list(takewhile(lambda tick: tick.clearance_m > 0.0, ticks)))
    return ticks[: apart + 1], outcome
