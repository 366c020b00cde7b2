"""One process per role and robot, over real sockets."""

from contextlib import ExitStack

import pytest

from protocol.bus.bus import Bus, DuplicateWatch, NameTakenError, claim, open_bus
from protocol.bus.network import Network
from protocol.topics import Role
from tests.support.until import until

ANYWHERE = "tcp/127.0.0.1:0"


def router(scope: ExitStack) -> Network:
    hub = scope.enter_context(open_bus(Network(mode="router", listen=(ANYWHERE,)), None, "r1"))
    return Network(mode="client", connect=(hub.locator(),))


def joined(scope: ExitStack, network: Network, role: Role, robot: str) -> Bus:
    return scope.enter_context(open_bus(network, role, robot))


@pytest.mark.parametrize("role", [Role.ROBOT, Role.PLANT])
def test_a_second_process_of_one_name_is_refused_by_name(role: Role) -> None:
    with ExitStack() as scope:
        network = router(scope)
        first, second = (joined(scope, network, role, "r1") for _ in range(2))
        claim(first, ["r1"])
        with pytest.raises(NameTakenError, match=f"a {role.value} for r1 already.*{first.zid}"):
            claim(second, ["r1"])


def test_other_names_and_other_roles_are_welcome() -> None:
    with ExitStack() as scope:
        network = router(scope)
        claim(joined(scope, network, Role.ROBOT, "r1"), ["r1"])
        claim(joined(scope, network, Role.ROBOT, "r2"), ["r2"])
        claim(joined(scope, network, Role.PLANT, "r1"), ["r1", "r2"])


def test_a_plant_of_several_robots_takes_each_name() -> None:
    with ExitStack() as scope:
        network = router(scope)
        claim(joined(scope, network, Role.PLANT, "r1"), ["r1", "r2"])
        with pytest.raises(NameTakenError, match="r2"):
            claim(joined(scope, network, Role.PLANT, "r2"), ["r2"])


def test_a_name_is_free_again_when_its_process_is_gone() -> None:
    with ExitStack() as scope:
        network = router(scope)
        with open_bus(network, Role.ROBOT, "r1") as first:
            claim(first, ["r1"])
        claim(joined(scope, network, Role.ROBOT, "r1"), ["r1"])


def test_later_duplicate_name_is_reported_while_present() -> None:
    """Reproduce a healed network partition: neither robot saw the other when it started."""
    with ExitStack() as scope:
        network = router(scope)
        first = joined(scope, network, Role.ROBOT, "r1")
        claim(first, ["r1"])
        twins = DuplicateWatch(first)
        for role, robot in ((Role.PLANT, "r1"), (Role.GROUND, "r1"), (Role.ROBOT, "r2")):
            joined(scope, network, role, robot).announce()
        second = joined(scope, network, Role.ROBOT, "r1")
        until(lambda: len(first.present()) == 4, what="all others are there")
        assert not twins
        second.announce()
        until(lambda: bool(twins), what="the second is there")
        second.close()
        until(lambda: not twins, what="the second is gone")


def test_a_second_that_was_there_before_is_seen_too() -> None:
    with ExitStack() as scope:
        network = router(scope)
        first, second = (joined(scope, network, Role.ROBOT, "r1") for _ in range(2))
        second.announce()
        twins = DuplicateWatch(first)
        until(lambda: bool(twins), what="the second is there")
