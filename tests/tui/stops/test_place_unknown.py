"""The alarm names the keys that set an unknown position, and those keys work."""

from math import nan

from msgspec.structs import replace

from ground.app.input.keymap import keymap_of
from protocol.topics import ODOMETRY, TRUTH
from tests.support.each import each
from tests.support.tui.fakes import FakeStation
from tests.support.tui.pilot import Stage, play, staged
from tests.support.tui.underway import drive_messages

REFUSES = "PLACE UNKNOWN of r1: it refuses goals. "
TRUE = "Enter sets its true pose"
BY_HAND = "X Y DEG and Enter set its pose"


def lost(*, simulated: bool) -> FakeStation:
    """Return a station whose robot does not know its place."""
    station = FakeStation()
    messages = drive_messages(station.now_ns)
    messages[ODOMETRY] = replace(messages[ODOMETRY], cov_xx_m2=nan)
    for topic, message in messages.items():
        if simulated or topic is not TRUTH:
            station.air.put(topic, message, station.now_ns)
    return station


def alarm(stage: Stage) -> str:
    return " ".join(stage.words("alarm").split())


@each(
    ("simulated", "entered", "typed", "sent"),
    [(True, TRUE, "", "pose truth"), (False, BY_HAND, "1 2 90", "pose set 1 2 90")],
)
def test_keys_that_the_alarm_names_set_the_pose(
    simulated: bool, entered: str, typed: str, sent: str
) -> None:
    async def story() -> None:
        async with staged((120, 40), station=lost(simulated=simulated)) as stage:
            assert alarm(stage) == f"{REFUSES}i, then {entered}"
            await stage.press("i")
            assert alarm(stage) == f"{REFUSES}{entered}"
            await stage.type(typed)
            await stage.press("enter")
            assert stage.commands.given == [sent]

    play(story)


def test_alarm_names_the_way_to_where_the_key_works() -> None:
    async def story() -> None:
        async with staged((120, 40), station=lost(simulated=True)) as stage:
            await stage.press("4")
            assert alarm(stage) == f"{REFUSES}1 Drive, then i, then {TRUE}"
            await stage.press("1", "colon")
            assert alarm(stage) == f"{REFUSES}esc, then i, then {TRUE}"

    play(story)


@each(
    ("simulated", "steps"),
    [(True, f":pose truth, then {TRUE}"), (False, f":pose set, then {BY_HAND}")],
)
def test_alarm_names_the_command_without_a_key(simulated: bool, steps: str) -> None:
    async def story() -> None:
        keymap = keymap_of({"keys": {"place": []}}, file="keys.toml")
        async with staged((120, 40), station=lost(simulated=simulated), keymap=keymap) as stage:
            assert alarm(stage) == f"{REFUSES}{steps}"

    play(story)
