"""The verb `param` shows limits and directions of safety parameters."""

import json
from typing import Any

import pytest

from ground.client.operations import parameters
from ground.client.parameter import parameters_in
from protocol.wire.reasons import Reason
from robot.core.parameters import DEFAULTS
from robot.parameter_table import described, with_value

STRICTER = with_value(DEFAULTS, "op_lost_ms", 900)
ROWS = parameters_in(json.dumps(described(STRICTER, DEFAULTS)))
LINK: Any = None


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("op_lost_ms", "; configured: 1500 ms, no higher"),
        ("guard_stop_m", "; configured: 0.04 m, no lower"),
        ("wheel_share", "; configured: 0.1, no lower"),
        ("track_m", "; configured: 0.2 m, within a tenth of that"),
    ],
)
def test_refusal_as_less_safe_shows_the_limit(
    name: str, words: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parameters, "fetch", lambda _: ROWS)
    assert parameters.hint(LINK, name, Reason.LESS_SAFE_THAN_CONFIGURED) == words


def test_list_shows_the_safer_direction() -> None:
    lines = {line.split()[0]: line.split() for line in parameters.table(ROWS).splitlines()}
    assert lines["name"][6] == "safer"
    assert lines["op_lost_ms"][:8] == [
        "op_lost_ms",
        "900",
        "*",
        "ms",
        "200",
        "60000",
        "1500",
        "down",
    ]
    assert "up" in lines["guard_stop_m"]
    assert not {"up", "down", "near"} & set(lines["d_th_m"][:7])
