"""Several plants of one world as processes: they pause, run and end together."""

from collections.abc import Iterator

import pytest

from checks.harness.crew import Crew, Witness
from checks.harness.processes import Running, is_accepted
from checks.harness.until import until
from plant.process import main
from protocol.topics import RUN
from protocol.wire.enums import RunAction
from protocol.wire.messages import RunRequest
from runtime.errors import UserError
from tests.support.each import each

NAMES = "r1,r2"


@pytest.fixture
def crew() -> Iterator[Crew]:
    with Crew(router=True, lockstep=True) as crew:
        yield crew


def plants(crew: Crew, *words: str) -> tuple[Running, Running]:
    """Start two robots and a plant for each; the first plant also gets these words."""
    places = ("--start", "0.6", "2", "0", "--start", "0.6", "2.6", "0")
    crew.dialling("robot", "--id", NAMES, *places, "--lockstep").says("robot r2: ready")
    first = crew.plant("--robots", NAMES, "--own", "r1", *words)
    return first, crew.plant("--robots", NAMES, "--own", "r2")


def test_robots_of_two_plants_see_each_other_and_drive(crew: Crew) -> None:
    plants(crew)
    with Witness(crew.endpoint, "r1") as first, Witness(crew.endpoint, "r2") as second:
        first.ready()
        second.ready()
        assert first.truth.clearance_m == second.truth.clearance_m == pytest.approx(0.36)
        assert crew.run("goto", "1.2", "2.6", "--id", "r2")[0] == 0
        until(lambda: first.truth.clearance_m > 0.4, "r1 notes that r2 has left")


def test_paused_plant_holds_all(crew: Crew) -> None:
    plants(crew, "--paused")
    with Witness(crew.endpoint, "r2") as second:
        until(lambda: len(second.truths) > 1, "the first tick, again")
        assert second.truth.time_ns == 0
        order = RunRequest(until_ns=0, action=RunAction.START)
        assert is_accepted(second.bus.ask(RUN, order, 5.0, robot="r2"))
        until(lambda: second.truth.time_ns > 0, "time")


def test_plants_end_with_one_of_them(crew: Crew) -> None:
    first, second = plants(crew)
    with Witness(crew.endpoint, "r1") as witness:
        witness.ready()
        second.process.kill()
        assert first.ends() == 1
    assert "plant: ends, because the plant of r2 has gone: start all plants" in first.said


@each(
    ("words", "reason"),
    [
        (("--robots", "r1,r2", "--own", "r3"), "--own r3: is not one of --robots r1,r2"),
        (("--robots", "r1,r2", "--own", "r1,r1"), "--own r1,r1: each robot needs a name"),
        (("--robots", "r1,r1"), "--robots r1,r1: each robot needs a name of its own"),
    ],
)
def test_plant_refuses_robots_that_are_not_of_its_world(
    words: tuple[str, ...], reason: str
) -> None:
    with pytest.raises(UserError) as caught:
        main(words)
    assert reason in str(caught.value)
