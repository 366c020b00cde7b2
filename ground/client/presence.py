"""The processes that run, and explanations for a robot that does not answer."""

import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import Final, NamedTuple, Protocol

from ground.client.vocabulary import SHELL
from protocol.bus.rights import PLANT, ROBOT
from protocol.options import DEFAULT_ENDPOINT
from protocol.topics import Role

UP: Final = "start a robot and its world with `sidestep up`"


class LivelinessToken(Protocol):
    """The liveliness token of one process."""

    @property
    def robot(self) -> str:
        """The robot that the process belongs to."""

    @property
    def role(self) -> str:
        """The role of the process, as in `Role`."""


class PresentProcesses(NamedTuple):
    """The processes whose liveliness tokens are on the bus, as pairs (robot, role)."""

    present: frozenset[tuple[str, str]]

    def has(self, robot: str, role: Role) -> bool:
        """Return whether a robot's process of this role runs."""
        return (robot, role.value) in self.present

    def robots(self) -> list[str]:
        """Return the names of the robots that run, sorted."""
        return sorted(name for name, role in self.present if role == Role.ROBOT.value)


def present_processes(present: Iterable[LivelinessToken]) -> PresentProcesses:
    """Collect the robot and role of each token."""
    return PresentProcesses(frozenset((token.robot, token.role) for token in present))


def explain_silence(
    processes: PresentProcesses,
    robot: str,
    endpoint: str,
    *,
    is_beating: bool,
    has_status: bool = True,
    other: str = SHELL.robot,
    keys: str | None = None,
) -> str:
    """Return why a robot does not answer and what to do, in the form "fault: remedy".

    `other` says how to name another robot, with a place for its name. `keys` is the operator's
    configuration file on a locked bus.
    """
    if not processes.has(robot, Role.ROBOT):
        return _no_robot(processes, robot, endpoint, other, keys)
    if not is_beating:
        what = f"robot {robot} is slow or hangs, its process is alive but sends no heartbeat"
        return f"{what}: restart it"
    if has_status:
        return f"robot {robot} sends its heartbeat, but does not answer requests"
    return explain_standstill(processes, robot, endpoint, keys)


def explain_standstill(
    processes: PresentProcesses, robot: str, endpoint: str, keys: str | None = None
) -> str:
    """Return why no time passes for a robot that sends its heartbeat, but no status.

    Only one in simulated time does so. In the form "fault: remedy".
    """
    what = f"the simulated time of {robot} stands still"
    if not processes.has(robot, Role.PLANT):
        return (
            f"{what}, no plant steps it: start one in its world W with `sidestep run plant"
            f" --lockstep --world W --robots {robot}{dial_options(endpoint, _beside(keys, PLANT))}`"
        )
    return f"{what}, its plant is paused, hangs or waits for another robot: restart that process"


def _no_robot(
    processes: PresentProcesses, robot: str, endpoint: str, other: str, keys: str | None
) -> str:
    others = processes.robots()
    if others:
        remedy = other.format(others[0])
        return f"robot {robot} is not at {endpoint}, only {', '.join(others)}: {remedy}"
    dial = dial_options(endpoint, _beside(keys, ROBOT + robot))
    alone = f"`sidestep run robot --id {robot}{dial}`"
    for role in (Role.PLANT, Role.DRIVER):
        if processes.has(robot, role):
            only = f"only its {role.value} is"
            return f"robot {robot} is not at {endpoint}, {only}: start it with {alone}"
    return (
        f"no robot at {endpoint}, though a process listens there: {UP}, or the robot alone with"
        f" {alone}"
    )


def _beside(keys: str | None, holder: str) -> str | None:
    """Return the configuration file of another process in the operator's folder of certificates."""
    return None if keys is None else str(Path(keys).with_name(f"{holder}.toml"))


def dial_options(endpoint: str, config: str | None = None) -> str:
    """Return the options that dial the same endpoints, separated by commas; none by default.

    `config` is the configuration file with which to dial them, if there is one.
    """
    words: list[str] = []
    if config is not None or endpoint not in ("", DEFAULT_ENDPOINT):
        words += [word for one in endpoint.split(", ") for word in ("--connect", one)]
    if config is not None:
        words += ["--config", config]
    return "".join(f" {shlex.quote(word)}" for word in words)
