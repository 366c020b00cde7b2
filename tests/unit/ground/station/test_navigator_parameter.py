"""Navigator and side have one value in the status, the parameters and every screen."""

from protocol.wire.enums import Navigator
from tests.support.ground.station.play import Play

LIST = b"""[{"name": "navigator", "value": 6, "default": 6, "unit": ""},
 {"name": "side", "value": 1, "default": 1, "unit": ""}]"""


def values(play: Play) -> dict[str, float]:
    return {one.name: one.value for one in play.station.parameters or ()}


def test_parameters_follow_the_navigator_of_the_status() -> None:
    play = Play()
    play.bus.answers["srv/parameters"] = lambda _: LIST
    play.forward(3.0)
    assert values(play)["navigator"] == Navigator.VGM
    changed = [one.name for one in play.station.parameters or () if not one.is_default]
    assert "navigator" in changed
