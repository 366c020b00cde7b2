"""The stop datagram: only an operator's own packet stops, and a doubtful one stops too."""

import hmac
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocol.bus.network import Network, Tls
from protocol.stop_datagram import (
    ANSWER_BODY,
    ANSWER_BYTES,
    KNOWN_IDS,
    PRESS_BODY,
    PRESS_BYTES,
    SECRET_BYTES,
    Press,
    PressVerdict,
    StopJudge,
    load_secrets,
    operators_secrets,
    places,
    press_in,
    sealed_answer,
    sealed_press,
    stopped_by,
)
from runtime.errors import EndpointError, KeysError
from tests.support.each import each

ADA, BOB = b"a" * 32, b"b" * 32
SECRETS = {"ada": ADA, "bob": BOB}
PRESS = Press("ada", 1_000, 77)
FALSE, REPLAY, STOP = PressVerdict.FALSE, PressVerdict.REPLAY, PressVerdict.STOP


def judge() -> StopJudge:
    return StopJudge("r1", SECRETS)


def packet(press: Press = PRESS, secret: bytes = ADA, robot: str = "r1") -> bytes:
    return sealed_press(secret, robot, press)


def verdict(judging: StopJudge, *press: Press) -> list[PressVerdict]:
    return [judging.judge(packet(one))[0] for one in press]


@given(st.integers(0, 2**64 - 1), st.integers(0, 2**64 - 1))
def test_the_press_of_an_operator_stops(stamp_ns: int, request_id: int) -> None:
    press = Press("ada", stamp_ns, request_id)
    assert judge().judge(packet(press)) == (STOP, press)


def test_the_numbers_of_the_page_are_those_of_the_code() -> None:
    assert (SECRET_BYTES, KNOWN_IDS) == (32, 256)
    assert len(packet()) == PRESS_BYTES == 85
    assert len(sealed_answer(ADA, "r1", PRESS, stopped=True)) == ANSWER_BYTES == 86


@each(
    "false",
    [
        packet(secret=BOB),
        packet(PRESS._replace(operator="bob")),  # with ada's secret
        packet(PRESS._replace(operator="eve")),
        packet(PRESS._replace(operator="open"), b""),
        packet(PRESS, b""),
        packet(robot="r2"),
        packet(robot="r11"),
        packet()[:-1],
        packet() + b"\0",
        b"",
        bytes(PRESS_BYTES),
        sealed_answer(ADA, "r1", PRESS, stopped=True),
        sealed_answer(ADA, "r1", PRESS, stopped=True)[:PRESS_BYTES],
    ],
)
def test_any_other_packet_is_false(false: bytes) -> None:
    assert judge().judge(false) == (FALSE, None)


@each("place", range(PRESS_BYTES))
def test_a_changed_byte_makes_a_press_false(place: int) -> None:
    changed = bytearray(packet())
    changed[place] ^= 1
    assert judge().judge(bytes(changed)) == (FALSE, None)


def resealed(body: bytes) -> bytes:
    return body + hmac.digest(ADA, body, "sha256")


@each(
    "body",
    [
        PRESS_BODY.pack(b"SSTQ", 1, b"r1", b"ada", 1, 2),
        PRESS_BODY.pack(b"SSTP", 2, b"r1", b"ada", 1, 2),
        PRESS_BODY.pack(b"SSTP", 1, b"r1", b"\xff\xfe", 1, 2),
        PRESS_BODY.pack(b"SSTP", 1, b"r1X", b"ada", 1, 2),
        PRESS_BODY.pack(b"SSTP", 1, b"r1", b"adaX", 1, 2),
    ],
)
def test_an_authentic_packet_of_another_form_is_false(body: bytes) -> None:
    assert judge().judge(resealed(body)) == (FALSE, None)


def test_an_open_bus_needs_no_secret_and_takes_only_the_open_operator() -> None:
    everyone = StopJudge("r1", None)
    assert everyone.judge(packet(PRESS._replace(operator="open"), b""))[0] is STOP
    assert everyone.judge(packet(PRESS, b""))[0] is FALSE


def test_a_copy_is_a_replay_and_a_repetition_stops_again() -> None:
    again = PRESS._replace(stamp_ns=PRESS.stamp_ns + 1)
    late = PRESS._replace(stamp_ns=PRESS.stamp_ns - 1)
    expected = [STOP, REPLAY, STOP, REPLAY, REPLAY]
    assert verdict(judge(), PRESS, PRESS, again, PRESS, late) == expected


def test_a_doubtful_press_stops() -> None:
    """The operator's clock was set back, or the robot has forgotten what it knew."""
    older = Press("ada", 5, 78)
    assert verdict(judge(), PRESS, older, older) == [STOP, STOP, REPLAY]
    assert verdict(judge(), PRESS) == [STOP], "after a restart a copy stops once more"


def test_the_presses_of_others_make_nobody_forget() -> None:
    judging = judge()
    assert verdict(judging, PRESS) == [STOP]
    for number in range(KNOWN_IDS):
        judging.judge(packet(Press("bob", 2_000 + number, number), BOB))
    assert verdict(judging, PRESS) == [REPLAY]


def test_the_newest_presses_are_known() -> None:
    judging, others = judge(), [Press("ada", 2_000 + n, 1_000 + n) for n in range(KNOWN_IDS)]
    assert set(verdict(judging, PRESS, *others)) == {STOP}
    assert set(verdict(judging, *others)) == {REPLAY}
    assert verdict(judging, PRESS) == [STOP], "forgotten, and therefore doubtful"


def test_a_repeated_press_stays_known() -> None:
    judging = judge()
    half = KNOWN_IDS * 3 // 4
    others = [Press("ada", 2_000 + n, 1_000 + n) for n in range(2 * half)]
    again = PRESS._replace(stamp_ns=PRESS.stamp_ns + 1)
    assert set(verdict(judging, PRESS, *others[:half], again, *others[half:])) == {STOP}
    assert verdict(judging, again) == [REPLAY]


def test_the_answer_names_the_press_that_has_stopped() -> None:
    answer = sealed_answer(ADA, "r1", PRESS, stopped=True)
    assert stopped_by(answer, ADA, "r1", "ada") == PRESS.request_id
    assert stopped_by(sealed_answer(ADA, "r1", PRESS, stopped=False), ADA, "r1", "ada") is None
    assert press_in(answer, "r1", SECRETS.get) is None


@each(
    "false",
    [
        sealed_answer(BOB, "r1", PRESS, stopped=True),
        sealed_answer(ADA, "r2", PRESS, stopped=True),
        sealed_answer(ADA, "r1", PRESS._replace(operator="bob"), stopped=True),
        sealed_answer(ADA, "r1", PRESS, stopped=True)[:-1],
        sealed_answer(ADA, "r1", PRESS, stopped=True) + b"\0",
        packet(),
        packet() + b"\0",
        b"",
        bytes(10),
        bytes(ANSWER_BYTES),
        resealed(ANSWER_BODY.pack(b"SSTB", 1, b"r1", b"ada", 1, 2, True)),
        resealed(ANSWER_BODY.pack(b"SSTA", 2, b"r1", b"ada", 1, 2, True)),
        resealed(ANSWER_BODY.pack(b"SSTA", 1, b"r1X", b"ada", 1, 2, True)),
    ],
)
def test_no_other_packet_is_an_answer(false: bytes) -> None:
    assert stopped_by(false, ADA, "r1", "ada") is None


@each("place", range(ANSWER_BYTES))
def test_a_changed_byte_makes_an_answer_false(place: int) -> None:
    changed = bytearray(sealed_answer(ADA, "r1", PRESS, stopped=True))
    changed[place] ^= 1
    assert stopped_by(bytes(changed), ADA, "r1", "ada") is None


# The file of secrets.


def tls(folder: Path, text: str | None) -> Tls:
    if text is not None:
        (folder / "robot-r1.stops").write_text(text)
    name = str(folder / "robot-r1")
    return Tls(ca=str(folder / "ca.pem"), certificate=f"{name}.pem", key=f"{name}.key")


def test_a_missing_file_is_told_with_its_cure(tmp_path: Path) -> None:
    found = load_secrets(tls(tmp_path, None))
    assert found.by_name == {}
    assert "robot-r1.stops is missing: `sidestep keys stops DIR`" in found.missing


def test_the_secrets_of_revoked_operators_are_withdrawn(tmp_path: Path) -> None:
    names = ("ada", "bob", "ground", "gateway")
    lines = "".join(f'{name} = "{ADA.hex()}"\n' for name in names)
    locked = tls(tmp_path, f"[secrets]\n{lines}")
    assert set(load_secrets(locked).by_name) == set(names)
    assert load_secrets(locked).by_name["bob"] == ADA
    assert load_secrets(locked).missing == ""
    revoked = Network(tls=locked, revoked=("ground-bob", "gateway", "ada"))
    found = operators_secrets(revoked)
    assert found is not None
    assert set(found.by_name) == {"ada", "ground"}
    assert operators_secrets(Network()) is None


@each(
    ("text", "named"),
    [
        ('[secrets]\nada = "00"', "ada"),
        (f'[secrets]\nada = "{"zz" * 32}"', r"robot-r1\.stops: ada: not a name with 64"),
        (f'[secrets]\nada = "{"00" * 33}"', "ada"),
        (f'[secrets]\n"A B" = "{"00" * 32}"', "A B"),
        ("[secrets]\nada = 5", "secrets"),
        ("[secret]\n", "secret"),
        ("[secrets", "TOML"),
    ],
)
def test_a_wrong_file_is_refused_by_name(tmp_path: Path, text: str, named: str) -> None:
    with pytest.raises(KeysError, match=named) as refused:
        load_secrets(tls(tmp_path, text))
    assert "robot-r1.stops" in str(refused.value)


def test_a_folder_that_cannot_be_searched_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(_path: Path) -> bool:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(Path, "exists", refuse)
    with pytest.raises(KeysError, match=r"robot-r1\.stops: Permission denied$"):
        load_secrets(tls(tmp_path, None))


# Addresses.


def test_a_robot_receives_stops_where_it_listens_unless_another_place_is_named() -> None:
    endpoints = (
        "tcp/127.0.0.1:7447",
        "tls/[::1]:7448",
        "tls/XX:1#a=b",
        "tcp/h:2?c=d",
        "unixsock-stream/a/b",
    )
    expected = [("127.0.0.1", 7447), ("::1", 7448), ("XX", 1), ("h", 2)]
    assert places(Network(), "r1", endpoints) == expected
    named = Network(stop_at={"r1": "10.0.0.5:7500"})
    assert places(named, "r1", endpoints) == [("10.0.0.5", 7500)]
    assert places(named, "r2", ()) == []


@each("address", ["", "host", ":7447", "host:", "host:x", "host:65536", "host:-1"])
def test_a_wrong_address_is_refused(address: str) -> None:
    with pytest.raises(EndpointError, match="HOST:PORT"):
        Network(stop_at={"r1": address})
