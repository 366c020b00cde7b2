"""With any content in the saved fence and mission, the robot starts and reports it."""

import json
import tempfile
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from protocol.wire.message import check
from protocol.wire.messages import MissionItemInt
from robot.storage import Store
from tests.support.robot.mission.items import corners, line
from tests.support.robot.vehicles import Desk

scalars = st.one_of(st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=20))
anything = st.recursive(
    scalars,
    lambda inner: st.one_of(st.lists(inner), st.dictionaries(st.text(max_size=9), inner)),
    max_leaves=20,
)
GOOD = [*corners((-1.0, -1.0), (2.0, -1.0), (2.0, 1.0)), *line(2)]
names = st.sampled_from(MissionItemInt.__struct_fields__)
spoilt = st.tuples(st.sampled_from(GOOD), st.dictionaries(names, scalars, max_size=2)).map(
    lambda pair: (
        {name: getattr(pair[0], name) for name in MissionItemInt.__struct_fields__} | pair[1]
    )
)


def starts(fence: str, mission: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "fence.json").write_text(fence, encoding="utf-8", errors="surrogatepass")
        (Path(folder) / "mission.json").write_text(mission, encoding="utf-8")
        desk = Desk(Store(Path(folder)))
        desk.vehicle.restore()
        assert len(desk.vehicle.restored) == 2, "each is announced, restored or not"
        for text in desk.vehicle.texts():
            check(text)
        desk.step()
        desk.step()


@settings(deadline=None, max_examples=60)
@given(st.text(max_size=200), anything.map(json.dumps))
def test_any_text_and_any_json_is_survived(fence: str, mission: str) -> None:
    starts(fence, mission)


@settings(deadline=None, max_examples=150)
@given(st.lists(spoilt, max_size=5), st.lists(spoilt, max_size=5))
def test_items_with_any_values_in_them_are_survived(
    fence: list[dict[str, object]], mission: list[dict[str, object]]
) -> None:
    starts(json.dumps(fence), json.dumps(mission))
