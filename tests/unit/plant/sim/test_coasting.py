"""Without obstacles near, skipping the physics engine gives bit-identical results."""

from hypothesis import given, settings
from hypothesis import strategies as st

from plant.corpus import generate
from plant.model.configuration import LEVELS
from plant.sim.simulation import Plant
from protocol.wire.messages import RunScore
from tests.support.each import each

FASTEST_MRAD_S = 9000
COMMANDS = st.lists(
    st.tuples(
        st.integers(-FASTEST_MRAD_S, FASTEST_MRAD_S), st.integers(-FASTEST_MRAD_S, FASTEST_MRAD_S)
    ),
    min_size=1,
    max_size=6,
)


def driven(
    family: str, commands: list[tuple[int, int]], noise: str, *, always_ask: bool
) -> RunScore:
    """Return the score after two seconds of each command."""
    plant = Plant(generate(family, 1, 9), 3, LEVELS[noise])
    if always_ask:
        plant._alone = False
    for left_mrad_s, right_mrad_s in commands:
        for _ in range(40):
            plant.command(0, left_mrad_s, right_mrad_s, 300)
            plant.advance()
    return plant.score(plant.now_ns)


@settings(max_examples=15, deadline=None)
@given(
    st.sampled_from(["forest_dense", "u_trap", "maze", "open", "door"]),
    COMMANDS,
    st.sampled_from(list(LEVELS)),
)
def test_trajectory_is_identical_with_and_without_the_arena(
    family: str, commands: list[tuple[int, int]], noise: str
) -> None:
    one = driven(family, commands, noise, always_ask=False)
    assert one == driven(family, commands, noise, always_ask=True)


@each("family", ["forest_dense", "maze"])
def test_trajectory_is_identical_through_contacts_too(family: str) -> None:
    commands = [(9000, 9000), (-9000, -8500), (9000, 8000), (-9000, -9000), (9000, 9000)] * 2
    one = driven(family, commands, "harsh", always_ask=False)
    assert one.contacts > 1
    assert one == driven(family, commands, "harsh", always_ask=True)
