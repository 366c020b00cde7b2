"""Inputs that the fuzzer found: each crashed its decoder or kept it busy forever."""

from pathlib import Path

import msgspec
import pytest

from checks.fuzz.hunt import TARGETS, limited, watch
from checks.fuzz.logs import TICK_MESSAGES, bomb
from checks.fuzz.wire import packed
from protocol.wire.messages import PlanarOdometry

DOTTED = b"a" + b".a" * 60_000 + b" = 1"
LONG = b"[parameters]\nd_obs_m = " + b"9" * 5000
HUGE = b"[parameters]\nd_obs_m = 0x" + b"f" * 400
PLAN = b"""{"fileType": "Plan", "mission": {"plannedHomePosition": [48.1, 11.5, 0], "items": []},
"geoFence": {"circles": [{"inclusion": true, "circle": {"center": [1e308, 1], "radius": 1}}]}}"""
ROUND = b"[fence]\ncorners = [" + b", ".join(b"[%d, %d]" % (n, n * n) for n in range(400)) + b"]"

HEADLESS = msgspec.structs.replace(
    next(one for one in TICK_MESSAGES if isinstance(one, PlanarOdometry)), heading_rad=float("nan")
)

FOUND = {
    "a key of sixty thousand parts in a world": ("world", DOTTED),
    "the same in a mission": ("mission_toml", DOTTED),
    "the same in a configuration": ("settings", DOTTED),
    "a configuration that is deep": ("settings", b"a = " + b"[" * 100_000),
    "a number too long to be read": ("settings", LONG),
    "a number too large for a float": ("parameter_file", HUGE),
    "a number too long in a mission": ("mission_toml", b"a = " + b"9" * 5000),
    "a fence of very many corners": ("fence", ROUND),
    "a fence beyond the Earth": ("mission_plan", PLAN),
    "saved parameters that are deep": ("stored_parameters", b"[" * 100_000),
    "saved parameters too large for a float": (
        "stored_parameters",
        b'{"d_obs_m": ' + b"9" * 4000 + b"}",
    ),
    "a list of parameters that is deep": ("parameter_list", b"[" * 100_000),
    "a deeply nested world of the plant": ("world_facts", b'{"a":' * 100_000),
    "settings of a study that are deep": ("study_settings", b"[" * 100_000),
    "rows of a study with a name that is no text": (
        "study_rows",
        TARGETS["study_rows"].good[0].replace(b"noise", b"n\xffise"),
    ),
    "a number with what is no blank before it": (
        "scenarios",
        b"version 1\n0\tworld.map\t\x1e16\t12\t1\t1\t9\t8\t11.2\n",
    ),
    "an origin that is no address": (
        "door",
        b"/ws\nCookie: sidestep_8765=abcdefgh0123456789\nOrigin: http://[\n",
    ),
    "a robot with a heading that is no number": ("recording", packed(HEADLESS, after=1)),
    "a table of truth values two bytes wide": (
        "barn_grid",
        TARGETS["barn_grid"].good[2].replace(b"|b1", b"|b2"),
    ),
    "a port of very many digits": ("web_address", b"127.0.0.1:" + b"9" * 6600),
    "settings of a study whose worlds are a text": ("study_settings", b'{"worlds": "box"}'),
    "a port in non-ASCII digits": ("web_address", "127.0.0.1:8²".encode()),
    "a kilobyte that unpacks to a gigabyte": ("mcap", bomb(1 << 30, 9)),
    "a chunk that announces an exabyte": ("mcap", bomb(1 << 20, 9, announced=1 << 60)),
}


@pytest.mark.parametrize("found", FOUND.values(), ids=FOUND)
def test_input_is_refused_or_accepted_in_time(found: tuple[str, bytes], tmp_path: Path) -> None:
    name, data = found
    with watch(), limited(5.0):
        TARGETS[name].accepts(data, tmp_path)
