"""Rows 20, 21 and 23: pymavlink's own FTP client reads what the gateway serves."""

from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from pymavlink.mavftp import MAVFTP, FtpError

from robot.parameter_table import SPECS
from tests.support.gateway.file_client import SimulatedLink, client_on
from tests.support.gateway.parameter_bench import ParameterBench

NAME = "20261123T131200Z-r1.tlog"
CONTENT = bytes(range(251)) * 300
ALL = len(SPECS) + 36


@pytest.fixture
def bench(tmp_path: Path) -> ParameterBench:
    (tmp_path / NAME).write_bytes(CONTENT)
    found = ParameterBench(tmp_path)
    found.values = {"d_obs_m": 0.45, "side": -1.0}
    return found


def got(client: Any, path: str) -> bytes:
    """Return a file as the client reads it."""
    contents: list[bytes] = []
    client.cmd_get([path], callback=lambda file: contents.append(file.read()))
    client.process_ftp_reply("OpenFileRO", timeout=60)
    return contents[0]


@pytest.mark.parametrize("block", [80, 110, 239])
def test_packed_parameters_with_defaults(
    bench: ParameterBench, monkeypatch: pytest.MonkeyPatch, block: int
) -> None:
    client = client_on(SimulatedLink(bench), monkeypatch, block)
    found = MAVFTP.ftp_param_decode(got(client, "@PARAM/param.pck?withdefaults=1"))
    assert found is not None
    values = {name.decode(): (value, kind) for name, value, kind in found.params}
    defaults = {name.decode(): value for name, value, _ in found.defaults or []}
    assert len(found.params) == len(values) == ALL
    assert values["D_OBS_M"][0] == pytest.approx(0.45)
    assert defaults["D_OBS_M"] == pytest.approx(0.3)
    assert (values["SIDE"], defaults["SIDE"]) == ((-1, 3), 1)
    assert values["RCMAP_YAW"] == (4, 3)


@pytest.mark.parametrize(
    ("query", "count"),
    [
        ("", ALL),
        ("?start=0&count=0", ALL),
        ("?start=5&count=10", 10),
        (f"?start={ALL - 1}", 1),
        ("?count=65534&withdefaults=0", ALL),
        ("?unknown=7", ALL),
    ],
)
def test_part_of_the_packed_parameters(
    bench: ParameterBench, monkeypatch: pytest.MonkeyPatch, query: str, count: int
) -> None:
    client = client_on(SimulatedLink(bench), monkeypatch)
    found = MAVFTP.ftp_param_decode(got(client, "@PARAM/param.pck" + query))
    assert found is not None
    assert len(found.params) == count


@pytest.mark.parametrize(
    "query", [f"start={ALL}", "start=65535", "count=-1", "start=x", "withdefaults=2", "start="]
)
def test_selection_that_cannot_be_used_is_refused(
    bench: ParameterBench, monkeypatch: pytest.MonkeyPatch, query: str
) -> None:
    client = client_on(SimulatedLink(bench), monkeypatch)
    client.cmd_get([f"@PARAM/param.pck?{query}"], callback=BytesIO)
    assert client.process_ftp_reply("OpenFileRO").error_code != FtpError.Success


def test_recording_is_downloaded_byte_for_byte(
    bench: ParameterBench, monkeypatch: pytest.MonkeyPatch
) -> None:
    client = client_on(SimulatedLink(bench), monkeypatch, 239)
    (entry,) = client.cmd_list(["/recordings"]).directory_listing
    assert (entry.name, entry.size_b) == (NAME, len(CONTENT))
    assert got(client, f"/recordings/{entry.name}") == CONTENT
    (entry,) = client.cmd_list(["@MAV_LOG"]).directory_listing
    assert got(client, f"@MAV_LOG/{entry.name}") == CONTENT


@pytest.mark.parametrize("seed", range(5))
def test_recording_survives_the_loss_of_every_fifth_frame(
    bench: ParameterBench, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    client = client_on(SimulatedLink(bench, 0.2, seed), monkeypatch, 239)
    assert got(client, f"/recordings/{NAME}") == CONTENT


@pytest.mark.parametrize("seed", range(20))
def test_parameters_survive_the_loss_of_every_fifth_frame(
    bench: ParameterBench, monkeypatch: pytest.MonkeyPatch, seed: int
) -> None:
    link = SimulatedLink(bench, 0.2, seed)
    client = client_on(link, monkeypatch)
    ended_s: list[float] = []
    contents: list[bytes] = []

    def keep(file: BytesIO) -> None:
        contents.append(file.read())
        ended_s.append(link.time())

    began_s = link.time()
    client.cmd_get(["@PARAM/param.pck?withdefaults=1"], callback=keep)
    client.process_ftp_reply("OpenFileRO", timeout=60)
    found = MAVFTP.ftp_param_decode(contents[0])
    assert found is not None
    assert len(found.params) == ALL
    assert ended_s[0] - began_s <= 5.0
