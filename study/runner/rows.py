"""One row per trial: request, outcome, driving statistics, code, libraries and machine.

A worker process imports this module, so it does without pyarrow: see `study.runner.store`.
"""

import platform
import sys
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from hashlib import sha256
from math import nan
from pathlib import Path
from types import MappingProxyType
from typing import Final, NamedTuple

from ground.recording.metadata import commit, version_of
from runtime.cli.compiled import is_compiled

ROOT: Final = Path(__file__).parents[2]
DRIVE_SOURCES: Final = ("robot/**/*.py", "plant/**/*.py", "protocol/**/*.py", "runtime/**/*.py")
TRIAL_SOURCES: Final = (
    "runtime/**/*.toml",
    "study/trial/trial.py",
    "study/trial/core_loop.py",
)


class CodeVersion(NamedTuple):
    """The code that runs; `digest` covers the files that a trial runs.

    Two commits may have the same digest.
    """

    commit: str
    dirty: bool
    version: str
    digest: str


class MachineInfo(NamedTuple):
    """Libraries and machine, under the names in `study.runner.rows.TrialRow`."""

    python: str
    numpy: str
    pymunk: str
    platform: str
    machine: str


@cache
def code() -> CodeVersion:
    """Return the running code; see `build_info.commit` for where the commit is known."""
    known = commit()
    return CodeVersion(
        commit=known.removesuffix("+"),
        dirty=known.endswith("+"),
        version=version_of("sidestep"),
        digest=code_digest(ROOT),
    )


@cache
def machine() -> MachineInfo:
    """Return libraries and machine of this process."""
    return MachineInfo(
        python=".".join(map(str, sys.version_info[:3])) + (", compiled" if is_compiled() else ""),
        numpy=version_of("numpy"),
        pymunk=version_of("pymunk"),
        platform=platform.platform(),
        machine=_processor(),
    )


def code_digest(root: Path) -> str:
    """Return the SHA-256 of the files that determine a trial, with their paths."""
    digest = sha256()
    for pattern in (*DRIVE_SOURCES, *TRIAL_SOURCES):
        for file in sorted(root.glob(pattern)):
            digest.update(f"{file.relative_to(root)}\0".encode())
            digest.update(file.read_bytes())
    return digest.hexdigest()


def _processor() -> str:
    """Return the processor model as the kernel names it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    models = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(models, "") or platform.processor() or platform.machine() or "unknown"


FAILED: Final = "failed"
"""Outcome of a trial that raised an exception or whose worker process died."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrialRow:
    """One trial. Positions are in the world frame; `true_` is from the plant, the rest estimated.

    None: unknown in principle (no path to the goal, any heading accepted). NaN: not measured, as
    the trial failed. `parameters` is a JSON object. `study.runner.plan.world_of` makes the world
    of `world_source` again. `own_contacts` are those that the robot's own motion caused.
    `mahalanobis2` is the squared true position error under the estimated covariance. `avoidances`
    counts how often avoiding began. `side_changes` counts changes between passing on the left and
    on the right. Heading for the goal between two avoidances on the same side is no change.

    `doubt_m` is the longer half axis of the confidence ellipse of the final estimate.
    `top_speed_m_s` is the robot's own. `lap_m` is the length of the boundary between the robot and
    an unreachable goal, None where there is a way. `thinnest_wall_m` is None in a world without
    walls on its floor. `spl` and `published_score` are those of `study.runner.run_task`, None
    without a way to the goal; an arrival with a contact counts as none.
    """

    study: str
    trial_id: str
    world: str
    world_source: str
    family: str
    world_digest: str
    navigator: str
    side: str
    seed: int
    noise: str
    timeout_s: float
    parameters: str
    calibrated: bool

    outcome: str
    reason: str
    goal_state: int
    goal_reason: int
    time_s: float
    path_m: float
    shortest_path_m: float | None
    reachable: bool | None
    lap_m: float | None
    thinnest_wall_m: float | None
    top_speed_m_s: float
    spl: float | None
    published_score: float | None
    position_error_m: float
    heading_error_rad: float | None
    estimated_position_error_m: float
    min_clearance_m: float
    mean_clearance_m: float
    contacts: int
    own_contacts: int
    ticks: int
    digest: str
    wall_s: float
    cpu_s: float

    true_x_m: float
    true_y_m: float
    true_heading_rad: float
    x_m: float
    y_m: float
    heading_rad: float
    cov_xx_m2: float
    cov_xy_m2: float
    cov_yy_m2: float
    cov_hh_rad2: float
    mahalanobis2: float
    doubt_m: float

    turned_rad: float
    side_changes: int
    avoidances: int
    ticks_to_goal: int
    ticks_passing_left: int
    ticks_passing_right: int
    ticks_aligning: int

    commit: str
    dirty: bool
    version: str
    python: str
    numpy: str
    pymunk: str
    platform: str
    machine: str
    started_utc: str


COLUMNS: Final = tuple(field.name for field in fields(TrialRow))

ADDED: Final[Mapping[str, float | None]] = MappingProxyType(
    {
        **dict.fromkeys(("lap_m", "thinnest_wall_m", "spl", "published_score")),
        **dict.fromkeys(("top_speed_m_s", "doubt_m"), nan),
    }
)
"""Columns that results of earlier versions lack, with the value of their rows."""
