"""The processes that run, and explanations for a robot that does not answer."""

from collections.abc import Iterable
from typing import Final, NamedTuple, Protocol

from ground.client.vocabulary import SHELL
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
) -> str:
    """Return why a robot does not answer and what to do, in the form "fault: remedy".

    `other` says how to name another robot.
    """
    if not processes.has(robot, Role.ROBOT):
        return _no_robot(processes, robot, endpoint, other)
    if not is_beating:
        what = f"robot {robot} is slow or hangs, its process is alive but sends no heartbeat"
        return f"{what}: restart it"
    if has_status:
        return f"robot {robot} sends its heartbeat, but does not answer requests"
    return explain_standstill(processes, robot, endpoint)


def explain_standstill(processes: PresentProcesses, robot: str, endpoint: str) -> str:
    """Return why no time passes for a robot that sends its heartbeat, but no status.

    Only one in simulated time does so. In the form "fault: remedy".
    """
    what = f"the simulated time of {robot} stands still"
    if not processes.has(robot, Role.PLANT):
        return (
            f"{what}, no plant steps it: start one in its world W with `sidestep run plant"
            f" --lockstep --world W --robots {robot}{connect_options(endpoint)}`"
        )
    return f"{what}, its plant is paused, hangs or waits for another robot: restart that process"


def _no_robot(processes: PresentProcesses, robot: str, endpoint: str, other: str) -> str:
    others = processes.robots()
    if others:
        return f"robot {robot} is not at {endpoint}, only {', '.join(others)}: {other}"
    alone = f"`sidestep run robot --id {robot}{connect_options(endpoint)}`"
    if processes.has(robot, Role.PLANT):
        return f"robot {robot} is not at {endpoint}, only its plant is: start it with {alone}"
    return (
        f"no robot at {endpoint}, though a process listens there: {UP}, or the robot alone with"
        f" {alone}"
    )


def connect_options(endpoint: str) -> str:
    """Return the options that dial the same endpoints, separated by commas; none by default."""
    if endpoint in ("", DEFAULT_ENDPOINT):
        return ""
    return "".join(f" --connect {one}" for one in endpoint.split(", "))
