"""Who is there and who is not, in words that say what to do about it."""

from collections.abc import Iterable
from typing import NamedTuple, Protocol

from protocol.topics import Role


class There(Protocol):
    """One liveliness token."""

    @property
    def robot(self) -> str: ...
    @property
    def role(self) -> str: ...


class Crew(NamedTuple):
    """Which processes have shown themselves, as (robot, role)."""

    there: frozenset[tuple[str, str]]

    def has(self, robot: str, role: Role) -> bool:
        return (robot, role.value) in self.there

    def robots(self) -> list[str]:
        return sorted(name for name, role in self.there if role == Role.ROBOT.value)


def crew_of(present: Iterable[There]) -> Crew:
    return Crew(frozenset((token.robot, token.role) for token in present))


def why_silent(crew: Crew, robot: str, endpoint: str, *, beats: bool) -> str:
    """Why a robot does not answer, from who is there and whether its heart beats."""
    if not crew.has(robot, Role.ROBOT):
        return _no_robot(crew, robot, endpoint)
    if beats:
        return f"robot {robot} is there and its heart beats, but it does not answer"
    if not crew.has(robot, Role.PLANT):
        return (
            f"robot {robot} is there but its control loop does not run and it has no plant: "
            "start one with `sidestep plant`"
        )
    return (
        f"robot {robot} hangs: its process is alive, its control loop does not run (no heartbeat); "
        "unless its plant is paused, restart it"
    )


def _no_robot(crew: Crew, robot: str, endpoint: str) -> str:
    others = crew.robots()
    if others:
        return f"robot {robot} is not at {endpoint}; there is {', '.join(others)}: use --id"
    start = f"start it with `sidestep robot --id {robot}`"
    if crew.has(robot, Role.PLANT):
        return f"robot {robot} is not at {endpoint}, only its plant is: {start}"
    return f"no robot at {endpoint}, though somebody answers there: {start}"
