"""Acknowledged changes survive a power cut, in every order of disk writes."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from checks.faults.power_cuts import ReorderingDisk, State, restore
from protocol.wire.enums import Command, MissionType
from protocol.wire.messages import MissionClearAll, MissionItemInt, ParamSet, ParamValue
from protocol.wire.reasons import Reason
from robot.core.parameters import DEFAULTS
from robot.emergency_stop import emergency_stop
from robot.file_writer import Directory
from robot.mission import MissionStore, text_of
from robot.storage import Store
from runtime import files
from tests.support.robot.mission.items import circle, line, upload
from tests.support.robot.vehicles import Desk

HOME = Path("/state/of/r1")
Held = tuple[float, str, str, bool]
"""A parameter, the fence, the mission and whether it is stopped: what a restart finds."""


class ChangingOperator:
    """Changes one setting after the other, and keeps the state that must survive."""

    def __init__(self) -> None:
        self.desk = Desk(Store(HOME))
        self.desk.vehicle.restore()
        self.desk.arm()
        self.held: Held = (DEFAULTS.d_obs_m, text_of(()), text_of(()), False)

    def put(self, items: list[MissionItemInt]) -> None:
        assert upload(self.desk, items).reason == Reason.NONE
        self._holds(items[0].mission_type, text_of(tuple(items)))

    def clear(self, kind: MissionType) -> None:
        answer = self.desk.vehicle.receive(MissionClearAll(mission_type=kind), 0)
        assert getattr(answer, "reason", None) == Reason.NONE
        self._holds(kind, text_of(()))

    def set(self, value: float) -> None:
        request = ParamSet(param_id="d_obs_m", param_value=value, param_type=9)
        assert isinstance(self.desk.vehicle.receive(request, 0), ParamValue)
        self.held = value, *self.held[1:]

    def _holds(self, kind: int, items: str) -> None:
        value, fence, mission, stopped = self.held
        fence = items if kind == MissionType.FENCE else fence
        mission = items if kind == MissionType.MISSION else mission
        self.held = value, fence, mission, stopped

    def stop(self) -> None:
        self.desk.vehicle.receive(emergency_stop(0), 0)
        self.held = *self.held[:3], True

    def release(self) -> None:
        assert self.desk.command(Command.SIDESTEP_CLEAR_EMERGENCY_STOP) == Reason.NONE
        self.held = *self.held[:3], False


STEPS: tuple[Callable[[ChangingOperator], None], ...] = (
    lambda owner: owner.put(circle(0.0, 0.0, 3.0)),
    lambda owner: owner.set(0.45),
    lambda owner: owner.put(line(2)),
    lambda owner: owner.stop(),
    lambda owner: owner.release(),
    lambda owner: owner.put(circle(0.0, 0.0, 5.0)),
    lambda owner: owner.stop(),
    lambda owner: owner.clear(MissionType.FENCE),
    lambda owner: owner.set(0.5),
    lambda owner: owner.put(circle(0.0, 0.0, 4.0)),
    lambda owner: owner.clear(MissionType.MISSION),
)


def found(state: State, folder: Path) -> Held:
    """Return the state of a robot that starts after this cut."""
    restore(state, folder)
    home = folder / str(HOME).removeprefix("/")
    kept = MissionStore(Directory(home))
    store = Store(home)
    params, warnings = store.load(DEFAULTS)
    assert warnings == []
    fence, mission = kept.found(MissionType.FENCE), kept.found(MissionType.MISSION)
    return params.d_obs_m, text_of(fence), text_of(mission), store.stop.found()


def outcomes(
    disk: ReorderingDisk, folder: Path
) -> Iterator[tuple[Held, Held, set[Held], set[Held]]]:
    """Yield for each step the states before and after it, and those of cuts during and after."""
    owner = ChangingOperator()
    known: dict[State, Held] = {}

    def all_found(states: frozenset[State]) -> set[Held]:
        for state in states - known.keys():
            known[state] = found(state, folder / str(len(known)))
        return {known[state] for state in states}

    for step in STEPS:
        before, begun = owner.held, len(disk.cuts)
        step(owner)
        during = {one for states in disk.cuts[begun:] for one in all_found(states)}
        yield before, owner.held, during, all_found(disk.cuts[-1])


def test_every_cut_keeps_acknowledged_changes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk = ReorderingDisk()
    monkeypatch.setattr(files, "os", disk)
    for before, after, during, at_the_end in outcomes(disk, tmp_path):
        assert during == {before, after}
        assert at_the_end == {after}


class UnsyncedDirectories(ReorderingDisk):
    """A disk as of a robot that does not synchronise directories."""

    def fsync(self, handle: int) -> None:
        if not self.isdir_open(handle):
            super().fsync(handle)


def test_unsynchronised_directory_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    disk = UnsyncedDirectories()
    monkeypatch.setattr(files, "os", disk)
    assert any(at_the_end != {after} for _, after, _, at_the_end in outcomes(disk, tmp_path))
