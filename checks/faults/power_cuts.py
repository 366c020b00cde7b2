"""Cut the power of a robot that saves: check that acknowledged changes survive it.

A parameter and the fence are changed in turn. The number of the repetition draws the disk operation
after which the power is cut. A robot is started from each state that a file system which reorders
writes may leave then.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Final, NamedTuple
from unittest.mock import patch

from checks.faults.cases import Repetition
from checks.harness.reordering_disk import ReorderingDisk, State
from ground.missions.mission import Circle
from ground.missions.transfer import fence_items_of
from protocol.wire.enums import MissionType
from protocol.wire.messages import MissionCount, MissionVerdict, ParamSet, ParamValue
from protocol.wire.reasons import Reason
from robot.core.parameters import DEFAULTS
from robot.storage import Store
from robot.vehicle import RobotVehicle
from runtime import files


@contextmanager
def restarted(state: State, folder: Path) -> Iterator[None]:
    """Write the files of a state below a real directory, which the code under test uses inside."""
    for path, content in state:
        file = folder / path.removeprefix("/")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_bytes(content)
    with patch.object(files, "os", os):
        yield


HOME: Final = Path("/state/of/r1")
CHANGES: Final = 6
TUNED: Final = "d_obs_m"


class SavedState(NamedTuple):
    """The operator's settings: a parameter, and the radius of the fence, 0 for none."""

    value: float = DEFAULTS.d_obs_m
    radius_m: float = 0.0


def run(fault: str, way: str, number: int, disk: ReorderingDisk | None = None) -> Repetition:
    """Cut the power once; the repetition has `reached` when all acknowledged changes are there."""
    disk, random = disk or ReorderingDisk(), Random(f"{fault} {number}")
    with patch.object(files, "os", disk), TemporaryDirectory() as folder:
        changes = make_changes(RobotVehicle(DEFAULTS, Store(HOME)), disk, random)
        cut = random.randrange(len(disk.cuts))
        answered, before = [one for one in changes if one[0] <= cut + 1][-1]
        under_way = next((state for operations, state in changes if operations > cut + 1), before)
        allowed = {before} if answered == cut + 1 else {before, under_way}
        found = {
            found_in(state, Path(folder) / str(index)) for index, state in enumerate(disk.cuts[cut])
        }
    lost = found - allowed
    words = f"after operation {cut}: {min(lost)} instead of {before}" if lost else ""
    return Repetition(fault=fault, way=way, number=number, reached=not lost, trouble=words)


def make_changes(
    vehicle: RobotVehicle, disk: ReorderingDisk, random: Random
) -> list[tuple[int, SavedState]]:
    """Make changes; return each state with the number of disk operations until its answer."""
    state = SavedState()
    changes = [(1, state)]
    for change in range(CHANGES):
        drawn = round(random.uniform(0.3, 0.5), 3) if change % 2 else random.randint(2, 9) * 1.0
        state = state._replace(value=drawn) if change % 2 else state._replace(radius_m=drawn)
        set_value(vehicle, drawn) if change % 2 else upload_fence(vehicle, drawn)
        changes.append((len(disk.cuts), state))

    return changes


def set_value(vehicle: RobotVehicle, value: float) -> None:
    """Set the parameter."""
    answer = vehicle.receive(ParamSet(param_id=TUNED, param_value=value, param_type=9), 0)
    if not isinstance(answer, ParamValue):
        raise RuntimeError(f"the robot did not set {TUNED}: {answer}")


def upload_fence(vehicle: RobotVehicle, radius_m: float) -> None:
    """Upload a round fence."""
    (fence,) = fence_items_of(Circle(x_m=0.0, y_m=0.0, radius_m=radius_m))
    vehicle.receive(MissionCount(count=1, mission_type=MissionType.FENCE), 0)
    answer = vehicle.receive(fence, 0)
    if not isinstance(answer, MissionVerdict) or answer.reason != Reason.NONE:
        raise RuntimeError(f"the robot did not accept the fence: {answer}")


def found_in(state: State, folder: Path) -> SavedState:
    """Return the state of a robot that is started after this cut."""
    with restarted(state, folder):
        store = Store(folder / str(HOME).removeprefix("/"))
        params, _ = store.load(DEFAULTS)
        vehicle = RobotVehicle(params, store)
        vehicle.restore()
    fence = vehicle.state.machine.fence
    return SavedState(params.d_obs_m, 0.0 if fence is None else fence.radius_m)
