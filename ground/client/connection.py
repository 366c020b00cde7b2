"""The robot and the endpoint to connect to, from the command line, a file or a runtime file."""

import shlex
from dataclasses import dataclass, replace
from numbers import Real
from pathlib import Path
from typing import Final

from ground.client.vocabulary import SHELL, Remedies
from ground.user.runs import FoundRun, read_runs
from ground.user.settings import context_named
from protocol.bus.network import Network
from protocol.options import dialled
from protocol.topics import robot_name
from runtime.config import load_shared
from runtime.errors import UserError

CONNECT_TIMEOUT_S: Final = 1.5
LONGEST_S: Final = 7 * 24 * 3600.0
OPERATOR_FILE: Final = "ground.toml"
"""Configuration of an operator in a folder of certificates."""
UP_HINT: Final = "`sidestep up` starts a robot and its world here"
START_HINT: Final = f"`sidestep ps` lists what runs here, {UP_HINT}"


@dataclass(frozen=True, kw_only=True)
class Config:
    """The keys of a `--config` file: the robot, and the network to connect to or listen on."""

    robot: str = "r1"
    network: Network | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Common:
    """The network to connect to and the robot to command.

    `config` is the file with the certificates. `source` is how the endpoint was found, empty if it
    was given. `hint` is added to the error when the endpoint does not answer. `robots` are those of
    the run at the endpoint, if it is one. `remedies` are in the words of those who read them.
    """

    network: Network
    robot: str
    config: str | None = None
    source: str = ""
    hint: str = UP_HINT
    robots: tuple[str, ...] = ()
    remedies: Remedies = SHELL

    @property
    def endpoint(self) -> str:
        """The endpoints to connect to, separated by commas."""
        return ", ".join(self.network.connect)

    @property
    def keys(self) -> str | None:
        """The configuration file, if its certificates are needed to dial."""
        return None if self.network.tls is None else self.config


def common(
    endpoint: str | None,
    robot: str | None,
    config: str | Path | None,
    run: str | None = None,
    context: str | None = None,
    *,
    remedies: Remedies = SHELL,
) -> Common:
    """Merge defaults, the configuration file and explicit values, in this order.

    Without an endpoint and a file, take the endpoint from the context of this name or the one in
    force, else from the runtime file of `up`: that of `run`, or the only one there is. Raises
    UserError or ConfigError for a value that is wrong, and if several runs are there and none is
    named.
    """
    typed = {"connect": endpoint, "run": run, "context": context, "id": robot, "config": config}
    given_words = [word for name, one in typed.items() if one for word in (f"--{name}", str(one))]
    remedies = remedies._replace(options="".join(f" {shlex.quote(word)}" for word in given_words))
    ways = [endpoint or config, run, context]
    if sum(way is not None for way in ways) > 1:
        raise UserError("use only one of --connect (or --config), --run and --context")
    if endpoint is not None or config is not None:
        return replace(given(endpoint, robot, config), remedies=remedies)
    if run is None and (chosen := context_named(context)) is not None:
        name, place = chosen
        found_by_name = given(place.connect, robot or place.id, place.config)
        source = f"context {name} at {found_by_name.endpoint}"
        return replace(found_by_name, source=source, remedies=remedies)
    found = chosen_run(run, remedies)
    if found is None:
        return replace(given(None, robot, None), hint=START_HINT, remedies=remedies)
    name, facts = found
    locks = None if facts.locks is None else Path(facts.locks) / OPERATOR_FILE
    linked = given(facts.endpoint, robot or facts.robots[0], locks)
    return replace(
        linked,
        network=replace(linked.network, stop_at={**facts.stop_at, **linked.network.stop_at}),
        robots=tuple(facts.robots),
        source=f"run {name} at {facts.endpoint}",
        hint=f"it is the endpoint of `up` {name}, see `sidestep ps`",
        remedies=remedies,
    )


def given(endpoint: str | None, robot: str | None, config: str | Path | None) -> Common:
    """Merge defaults, the configuration file and explicit values, in this order."""
    found = Config() if config is None else load_shared(Path(config), Config)
    network = found.network or Network()
    connect = dialled(network) if endpoint is None else (endpoint,)
    network = replace(
        network, mode="client", connect=connect, listen=(), connect_timeout_s=CONNECT_TIMEOUT_S
    )
    return Common(
        network=network,
        robot=robot_name(found.robot if robot is None else robot),
        config=None if config is None else str(config),
    )


def chosen_run(name: str | None, remedies: Remedies = SHELL) -> FoundRun | None:
    """Return the run of this name, or without a name the only one; None if nothing runs.

    Raises UserError for an unknown name, and for several runs without a name.
    """
    found = read_runs().found
    listed = ", ".join(f"{one.name} ({one.run.endpoint})" for one in found)
    if name is not None:
        for one in found:
            if one.name == name:
                return one
        here = f"here run: {listed}" if found else f"nothing runs here: {START_HINT}"
        raise UserError(f"--run {name}: there is no such run; {here}")
    if len(found) > 1:
        choose = remedies.run.format(found[0].name, found[0].run.endpoint)
        raise UserError(f"{len(found)} runs are here: {listed}; {choose}")
    return found[0] if found else None


def within(value: float, low: float, high: float, what: str, unit: str = "") -> float:
    """Return the value; UserError unless it is a number from `low` to `high` (in `unit`)."""
    if not isinstance(value, Real):
        how = f": give it in {unit}" if unit else ""
        raise UserError(f"{what} {value!r} is not a number{how}")
    if not low <= value <= high:
        of = f" {unit}" if unit else ""
        raise UserError(f"{what} {value:g}{of} is out of range: {low:g} to {high:g}{of}")
    return value
