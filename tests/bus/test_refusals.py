"""TLS refusals: the connecting side gets the reason, and no flood fills the log."""

import json
import socket
import subprocess
import sys
from contextlib import suppress
from datetime import UTC, datetime, timedelta
from pathlib import Path
from threading import Thread

import pytest

from checks.harness.until import until
from ground.cli.main import main
from protocol.bus import certificate, session
from protocol.bus.bus import Bus, open_bus
from protocol.bus.certificate import NO_TLS, RENEW, WAIT
from protocol.bus.network import Network, Tls
from protocol.topics import Role
from runtime.errors import AccessDeniedError, KeysError, PeerHangsError, UserError
from tests.support.networks import Keyring

LISTENER = """
import os, sys, time
from pathlib import Path
import zenoh
from protocol.bus.bus import open_bus
from protocol.bus.audit import audited_connections
from protocol.bus.session import configured
from protocol.bus.network import Network
from protocol.topics import Role
from tests.support.networks import Keyring

def caught():
    # Bytes of the files in memory that this process has open.
    files = [Path(f"/proc/self/fd/{n}") for n in range(100)]
    return sum(f.stat().st_size for f in files if f.is_symlink() and "memfd" in os.readlink(f))

ring, told, largest = Keyring(Path(sys.argv[1])), [], 0
listening = Network(listen=("tls/127.0.0.1:0",), robots=("r1",), tls=ring.tls("robot-r1"))
with open_bus(listening, Role.ROBOT, "r1") as bus, audited_connections(bus, told.append):
    endpoint = bus.locator()
    dialling = Network(
        mode="client", connect=(endpoint,), robots=("r1",), tls=ring.tls("viewer"))
    with zenoh.open(configured(dialling, 2.0)) as viewer:
        until_s = time.monotonic() + 60.0
        for number in range(int(sys.argv[3])):
            key = sys.argv[2].format(zid=bus.zid) * int(sys.argv[4])
            viewer.put(f"sidestep/r1/tlm/{number}{key}", b"x",
                       congestion_control=zenoh.CongestionControl.BLOCK)
            largest = max(largest, caught() if number % 20 == 0 else 0)
        while not told and time.monotonic() < until_s:
            time.sleep(0.01)
sys.stderr.write("".join(f"{line}\\n" for line in told))
print(largest)
"""


def told(folder: Path, key: str, times: int, length: int) -> tuple[str, int]:
    """Return the log of a listener, and the most bytes of in-memory files that it held."""
    done = subprocess.run(
        [sys.executable, "-c", LISTENER, str(folder / "ring"), key, str(times), str(length)],
        capture_output=True,
        text=True,
        timeout=180.0,
        check=False,
        env={"PYTHONPATH": ":".join(sys.path)},
    )
    assert done.returncode == 0, done.stderr[-1000:]
    return done.stderr, int(done.stdout)


def test_flood_of_long_keys_costs_bounded_log_and_memory(tmp_path: Path) -> None:
    log, held_bytes = told(tmp_path, "x", 300, 60_000)
    assert "refused: viewer" in log
    assert len(log) < 10_000
    assert held_bytes < 1_000_000


FORGED = (
    "2026-11-21T22:13:59.056613Z TRACE  rx-0 ThreadId(09) "
    "zenoh::net::routing::interceptor::access_control: Using cached result: {zid} is unauthorized "
    "to Put (ingress) on sidestep/r1/srv/command"
)


@pytest.mark.parametrize("between", ["\n", " ", ""])
def test_viewer_cannot_write_a_refusal_of_another_session(tmp_path: Path, between: str) -> None:
    log, _ = told(tmp_path, f"{between}{FORGED}{between}", 1, 1)
    assert log.startswith("refused: viewer at 127.0.0.1:")
    assert log.count("\n") == log.count("refused: ") == 1
    assert " may not put on sidestep/r1/srv/command" not in log


DIAL_S = 0.4


@pytest.fixture
def ring(tmp_path: Path) -> Keyring:
    return Keyring(tmp_path / "ring")


def door(tls: Tls | None, host: str = "127.0.0.1") -> Network:
    """Return the network of a listening robot, with or without TLS."""
    protocol = "tls" if tls else "tcp"
    return Network(mode="peer", listen=(f"{protocol}/{host}:0",), tls=tls)


def dialling(endpoint: str, tls: Tls | None) -> Network:
    return Network(mode="client", connect=(endpoint,), tls=tls, connect_timeout_s=DIAL_S)


def refusal(ring: Keyring, tls: Tls | None, protocol: str = "tls") -> AccessDeniedError:
    """Return the refusal of a ground station that connects to a TLS robot."""
    with open_bus(door(ring.tls("robot-r1")), Role.ROBOT, "r1") as robot:
        endpoint = robot.locator().replace("tls/", f"{protocol}/")
        with pytest.raises(AccessDeniedError) as caught:
            open_bus(dialling(endpoint, tls), Role.GROUND, "r1")
        assert endpoint in caught.value.why
    return caught.value


def test_valid_certificate_is_accepted(ring: Keyring) -> None:
    with (
        open_bus(door(ring.tls("robot-r1")), Role.ROBOT, "r1") as robot,
        open_bus(dialling(robot.locator(), ring.tls("ground")), Role.GROUND, "r1") as ground,
    ):
        robot.announce()
        until(lambda: [who.role for who in ground.present()] == ["robot"])


def test_an_expired_certificate_is_named_with_its_end(ring: Keyring) -> None:
    tls = ring.expired("ground")
    refused = refusal(ring, tls)
    assert f"{tls.certificate} expired at" in refused.why
    assert refused.do == RENEW


def test_future_certificate_error_names_its_start(ring: Keyring) -> None:
    tls = ring.early("ground")
    refused = refusal(ring, tls)
    assert f"{tls.certificate} is not valid before" in refused.why
    assert refused.do == WAIT


def test_another_authority_is_named(ring: Keyring, tmp_path: Path) -> None:
    tls = Keyring(tmp_path / "other").tls("ground")
    assert f"signed by another authority than {tls.ca}" in refusal(ring, tls).why


def test_certificate_of_another_authority_is_rejected(ring: Keyring, tmp_path: Path) -> None:
    stranger = Keyring(tmp_path / "other").tls("ground")
    tls = Tls(ca=ring.tls("ground").ca, certificate=stranger.certificate, key=stranger.key)
    assert f"{tls.certificate} is not signed by {tls.ca}" in refusal(ring, tls).why


def test_plain_tcp_to_tls_error_names_the_config_option(ring: Keyring) -> None:
    told = refusal(ring, None, "tcp")
    assert "accepts only TLS, and this one uses plain TCP" in told.why
    assert "--config" in told.do


@pytest.mark.parametrize("comes_of_it", [None, *NO_TLS])
def test_tls_to_plain_tcp_is_reported(
    ring: Keyring, monkeypatch: pytest.MonkeyPatch, comes_of_it: type[OSError] | None
) -> None:
    """Cover each result of the handshake; it depends on the length of the TLS greeting."""

    def knock(*_: object) -> None:
        assert comes_of_it is not None
        raise comes_of_it

    if comes_of_it is not None:
        monkeypatch.setattr(certificate, "handshake", knock)
    with open_bus(door(None), Role.ROBOT, "r1") as robot:
        endpoint = robot.locator().replace("tcp/", "tls/")
        with pytest.raises(
            AccessDeniedError, match="uses plain TCP, and this one accepts only TLS"
        ):
            open_bus(dialling(endpoint, ring.tls("ground")), Role.GROUND, "r1")


@pytest.mark.parametrize("banner", [b"SSH-2.0-OpenSSH_9.2p1\r\n", b"HTTP/1.1 400 Bad\r\n\r\n"])
@pytest.mark.parametrize("is_locked", [False, True])
def test_another_program_is_not_told_to_want_certificates(
    ring: Keyring, banner: bytes, *, is_locked: bool
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:

        def answer() -> None:
            with server.accept()[0] as link:
                link.sendall(banner)
                link.recv(4096)

        Thread(target=answer, daemon=True).start()
        kind, tls = ("tls", ring.tls("operator")) if is_locked else ("tcp", None)
        why = certificate.refusal_at(f"{kind}/127.0.0.1:{server.getsockname()[1]}", tls)
    assert "another program listens at" in str(why)


def test_host_missing_in_the_certificate_is_reported(ring: Keyring) -> None:
    with open_bus(door(ring.tls("robot-r1"), "0.0.0.0"), Role.ROBOT, "r1") as robot:
        port = robot.locator().rpartition(":")[2]
        with pytest.raises(
            AccessDeniedError, match=r"is not for 127\.0\.0\.2.*--host 127\.0\.0\.2"
        ):
            open_bus(dialling(f"tls/127.0.0.2:{port}", ring.tls("ground")), Role.GROUND, "r1")


def test_client_certificate_is_rejected_on_a_listener(ring: Keyring) -> None:
    """Let a viewer pose as the robot."""
    with open_bus(door(ring.tls("viewer")), None, "r1") as posing:
        network = dialling(posing.locator(), ring.tls("ground"))
        with pytest.raises(AccessDeniedError, match="shows a certificate that"):
            open_bus(network, Role.GROUND, "r1")


def test_tls_peer_that_hangs_differs_from_a_refusal(
    ring: Keyring, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(session, "SLOW_DIAL_S", 0.2)
    monkeypatch.setattr(certificate, "HANDSHAKE_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as mute:
        endpoint = f"tls/127.0.0.1:{mute.getsockname()[1]}"
        with pytest.raises(PeerHangsError, match="does not answer"):
            open_bus(dialling(endpoint, ring.tls("ground")), Role.GROUND, "r1")


def test_listener_with_an_expired_certificate_does_not_start(ring: Keyring) -> None:
    tls = ring.expired("robot-r1")
    with pytest.raises(KeysError, match=f"{tls.certificate} expired at .* others would reject it"):
        open_bus(door(tls), Role.ROBOT, "r1")


@pytest.mark.parametrize(
    ("name", "role", "needs"),
    [
        ("ground", Role.PLANT, "plant"),
        ("plant", Role.ROBOT, "robot-r1"),
        ("robot-r2", Role.ROBOT, "robot-r1"),
    ],
)
def test_process_with_the_wrong_role_does_not_start(
    ring: Keyring, name: str, role: Role, needs: str
) -> None:
    with pytest.raises(KeysError, match=f"{name}.*needs that of '{needs}': use --config"):
        open_bus(dialling("tls/127.0.0.1:1", ring.tls(name)), role, "r1")


def test_mismatched_key_files_are_named(ring: Keyring) -> None:
    tls = Tls(
        ca=ring.tls("ground").ca,
        certificate=ring.tls("ground").certificate,
        key=ring.tls("viewer").key,
    )
    with pytest.raises(KeysError, match="cannot be used together") as caught:
        open_bus(dialling("tls/127.0.0.1:1", tls), Role.GROUND, "r1")
    assert "PRIVATE" not in str(caught.value)


def test_a_file_that_is_not_there_is_named_by_its_key(ring: Keyring) -> None:
    good = ring.tls("ground")
    tls = Tls(ca=good.ca, certificate=good.certificate, key="nowhere.key")
    with pytest.raises(UserError, match=r"network\.tls\.key: nowhere\.key: No such file"):
        open_bus(dialling("tls/127.0.0.1:1", tls), Role.GROUND, "r1")


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620])
def test_a_process_does_not_start_with_a_key_that_others_can_read(ring: Keyring, mode: int) -> None:
    tls = ring.tls("ground")
    Path(tls.key).chmod(mode)
    with pytest.raises(KeysError, match=r"other users can read .*ground\.key.*chmod 600"):
        open_bus(dialling("tls/127.0.0.1:1", tls), Role.GROUND, "r1")


def test_link_ends_when_the_peer_certificate_expires(ring: Keyring) -> None:
    """Close an open link when its certificate expires."""
    with open_bus(door(ring.tls("robot-r1")), Role.ROBOT, "r1") as robot:
        ground, until_s = linked_briefly(ring, robot.locator())
        with ground:
            until(lambda: not list(ground._session.info.links()))
            assert datetime.now(UTC) >= until_s - timedelta(seconds=1)


def linked_briefly(ring: Keyring, endpoint: str) -> tuple[Bus, datetime]:
    """Return a link whose certificate expires soon, and when; a busy machine takes long to dial."""
    for valid_s in (2, 8, 32):
        until_s = datetime.now(UTC) + timedelta(seconds=valid_s)
        tls = ring.tls("ground", until=until_s, label=f"brief{valid_s}")
        with suppress(AccessDeniedError):
            return open_bus(dialling(endpoint, tls), Role.GROUND, "r1"), until_s
    raise AssertionError("every certificate expired before the link was open")


def config(folder: Path, tls: Tls | None, endpoint: str) -> str:
    """Write the file for `--config` and return its path."""
    path = folder / "verb.toml"
    text = f'[network]\nconnect = ["{endpoint}"]\n'
    if tls:
        text += (
            f'[network.tls]\nca = "{tls.ca}"\n'
            f'certificate = "{tls.certificate}"\nkey = "{tls.key}"\n'
        )
    path.write_text(text)
    return str(path)


def test_viewer_command_is_refused_with_its_role(
    ring: Keyring, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with open_bus(door(ring.tls("robot-r1")), Role.ROBOT, "r1") as robot:
        acted: list[object] = []
        robot.serve_stop(lambda *_: acted.append("stop"), acted.append)
        robot.announce()
        file = config(tmp_path, ring.tls("viewer"), robot.locator())
        assert main(["estop", "--timeout", "0.3", "--config", file]) == 1
        said = capsys.readouterr().err
        assert "'viewer', which only observes and may not query srv/command" in said
        assert "--config DIR/ground.toml" in said
        assert acted == []


@pytest.mark.parametrize(
    ("name", "healthy", "says"),
    [
        ("viewer", True, "'viewer', which only observes and may not query srv/command"),
        ("plant", False, "'plant', which simulates the robots and may not query"),
        ("stranger", False, "'stranger', which is no role: it permits nothing"),
    ],
)
def test_doctor_reports_the_permissions_of_a_certificate(
    ring: Keyring,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    name: str,
    healthy: bool,
    says: str,
) -> None:
    with open_bus(door(ring.tls("robot-r1")), Role.ROBOT, "r1") as robot:
        file = config(tmp_path, ring.tls(name), robot.locator())
        main(["doctor", "--timeout", "0.1", "--json", "--config", file])
        found = json.loads(capsys.readouterr().out)["findings"]
        (finding,) = [one for one in found if says in one["what"]]
        assert finding["bad"] is not healthy
        assert "ground.toml" in finding["do"]


@pytest.mark.parametrize(
    ("label", "says"),
    [
        ("expired", "expired at"),
        ("early", "is not valid before"),
        ("foreign", "signed by another authority"),
        ("plain", "accepts only TLS, and this one uses plain TCP"),
    ],
)
def test_doctor_explains_a_tls_refusal(
    ring: Keyring, tmp_path: Path, capsys: pytest.CaptureFixture[str], label: str, says: str
) -> None:
    shown: dict[str, Tls | None] = {
        "expired": ring.expired("ground"),
        "early": ring.early("ground"),
        "foreign": Keyring(tmp_path / "other").tls("ground"),
        "plain": None,
    }
    with open_bus(door(ring.tls("robot-r1")), Role.ROBOT, "r1") as robot:
        tls = shown[label]
        endpoint = robot.locator() if tls else robot.locator().replace("tls/", "tcp/")
        assert main(["doctor", "--json", "--config", config(tmp_path, tls, endpoint)]) == 1
        (finding,) = json.loads(capsys.readouterr().out)["findings"]
        assert says in finding["what"]
        assert finding["do"]
