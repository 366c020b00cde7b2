"""The address of a rejected client is found in the connection table of the system."""

from pathlib import Path

import pytest

from protocol.bus.sockets import ClosingConnections, ConnectionEnd, end_in, end_of

HEAD = "  sl  local_address rem_address   st tx_queue rx_queue tr tm->when retrnsmt   uid\n"
OURS = 0x4427  # 17447
CLOSING = "06"


def row(local: str, remote: str, state: str = CLOSING) -> str:
    return (
        f"   0: {local} {remote} {state} 00000000:00000000 00:00000000 00000000 0 0 1603 1 0 20\n"
    )


@pytest.fixture
def table(tmp_path: Path) -> Path:
    return tmp_path / "tcp"


def test_an_address_is_read_as_linux_writes_it() -> None:
    assert end_of("0100007F:4427") == ConnectionEnd("127.0.0.1", 17447)
    assert end_of("00000000000000000000000001000000:0050") == ConnectionEnd("::1", 80)
    assert end_of("0000000000000000FFFF00000700000A:0050") == ConnectionEnd("10.0.0.7", 80)


def test_an_address_is_read_as_zenoh_writes_it() -> None:
    assert end_in("10.0.0.7:50000") == ConnectionEnd("10.0.0.7", 50000)
    assert end_in("[::1]:50000") == ConnectionEnd("::1", 50000)
    assert end_in("") == ConnectionEnd("", 0)


def test_closing_connection_counts_as_rejected_peer(table: Path) -> None:
    table.write_text(HEAD + row("0100007F:4427", "0700000A:C350"))
    assert ClosingConnections([OURS], [table]).new([]) == ["10.0.0.7"]


def test_local_peer_may_be_found_by_its_other_end(table: Path) -> None:
    table.write_text(HEAD + row("0200007F:C350", "0100007F:4427"))
    assert ClosingConnections([OURS], [table]).new([]) == ["127.0.0.2"]


def test_peer_is_reported_once(table: Path) -> None:
    strangers = ClosingConnections([OURS], [table])
    table.write_text(HEAD + row("0100007F:4427", "0700000A:C350"))
    assert strangers.new([]) == ["10.0.0.7"]
    assert strangers.new([]) == []
    table.write_text(HEAD + row("0100007F:4427", "0700000A:C351"))
    assert strangers.new([]) == ["10.0.0.7"]


def test_peer_admitted_before_is_not_reported(table: Path) -> None:
    table.write_text(HEAD + row("0100007F:4427", "0700000A:C350"))
    assert ClosingConnections([OURS], [table]).new([ConnectionEnd("10.0.0.7", 0xC350)]) == []


@pytest.mark.parametrize("state", ["01", "03", "0A"])
def test_open_or_opening_connection_is_not_reported(table: Path, state: str) -> None:
    table.write_text(HEAD + row("0100007F:4427", "0700000A:C350", state))
    assert ClosingConnections([OURS], [table]).new([]) == []


def test_connections_to_other_ports_are_ignored(table: Path) -> None:
    table.write_text(HEAD + row("0100007F:0016", "0700000A:C350"))
    assert ClosingConnections([OURS], [table]).new([]) == []


def test_missing_connection_table_gives_no_peer(tmp_path: Path) -> None:
    assert ClosingConnections([OURS], [tmp_path / "nowhere"]).new([]) == []
