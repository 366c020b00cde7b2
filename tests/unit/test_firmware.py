"""The firmware: frames in any stream of bytes, the linked program, its numbers and tools."""

from math import nextafter, pi
from pathlib import Path
from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from firmware import build
from firmware.board import Emulator, FrameStream
from firmware.build import main, sources, values
from firmware.image import Image
from firmware.linker import Binding, Program, exact, floats_in, is_literal, nearest
from protocol.wire.codec import HEADER_SIZE, LARGEST_FRAME, Encoder
from protocol.wire.message import Message
from protocol.wire.messages import BoardAnswer, BoardRestart
from runtime.errors import LocalError, UserError
from tests.support.each import each

ANSWERS = [BoardAnswer(request=n, message_id=54_123, reason=n % 3) for n in range(20)]


def frames() -> list[bytes]:
    encoder = Encoder(1, 1)
    return [encoder.encode(answer) for answer in ANSWERS]


def received(stream: FrameStream, data: bytes, size: int) -> list[Message]:
    """Feed pieces of this size."""
    return [
        message for at in range(0, len(data), size) for message in stream.feed(data[at : at + size])
    ]


@each("size", [1, 2, 7, 1000])
def test_frames_in_pieces_are_complete(size: int) -> None:
    stream = FrameStream()
    assert received(stream, b"".join(frames()), size) == ANSWERS
    assert stream.skipped == 0


@each("seed", range(20))
def test_garbage_between_frames_is_skipped_and_counted(seed: int) -> None:
    random, stream, garbage = Random(seed), FrameStream(), 0
    data = b""
    for frame in frames():
        noise = random.randbytes(random.randrange(60))
        garbage += len(noise)
        data += noise + frame
    assert received(stream, data, random.randrange(1, 99)) == ANSWERS
    assert stream.skipped == garbage


def test_damaged_length_does_not_hold_back_the_next_frame() -> None:
    first, second = frames()[:2]
    damaged = bytearray(first)
    damaged[1] += 1  # now as long as the first byte of the next frame
    assert received(FrameStream(), bytes(damaged) + second, 1) == [ANSWERS[1]]


def test_torn_frame_is_given_up_when_a_whole_one_follows() -> None:
    first, second = frames()[:2]
    stream = FrameStream()
    assert received(stream, first[:-1] + second, 1) == [ANSWERS[1]]
    assert stream.skipped == len(first) - 1


@each("at", [2, 7, 8, 9])
def test_header_of_no_known_message_is_skipped_at_once(at: int) -> None:
    damaged = bytearray(frames()[0])
    damaged[at] = 0xEE
    stream = FrameStream()
    assert received(stream, bytes(damaged[:HEADER_SIZE]), HEADER_SIZE) == []
    assert stream.skipped == HEADER_SIZE


def test_start_of_a_frame_waits_for_its_rest() -> None:
    frame = Encoder(1, 1).encode(BoardRestart(confirmation=54_127))
    stream = FrameStream()
    assert list(stream.feed(frame[:5])) == []
    assert list(stream.feed(frame[5:])) == [BoardRestart(confirmation=54_127)]
    assert stream.skipped == 0


ANSWER = BoardAnswer(request=7, message_id=54108, reason=3)
FRAME = Encoder(1, 1).encode(ANSWER)


@given(st.binary(max_size=40).filter(lambda noise: b"\xfd" not in noise), st.integers(1, 30))
def test_frames_between_noise_are_found_in_any_pieces(noise: bytes, size: int) -> None:
    stream = FrameStream()
    sent = noise + FRAME + noise + FRAME
    pieces = [sent[at : at + size] for at in range(0, len(sent), size)]
    found = [message for piece in pieces for message in stream.feed(piece)]
    assert found == [ANSWER, ANSWER]
    assert stream.skipped == 2 * len(noise)


@given(st.binary(max_size=600))
def test_no_bytes_raise_and_few_are_kept(noise: bytes) -> None:
    stream = FrameStream()
    list(stream.feed(noise))
    assert stream.waiting < LARGEST_FRAME


def test_frame_behind_a_false_start_is_found() -> None:
    stream = FrameStream()
    assert list(stream.feed(b"\xfd\x03\x00" + FRAME + FRAME)) == [ANSWER, ANSWER]
    assert stream.skipped == 3


DRIVE = """
from robot.core import brain, modes, states
from robot.core.parameters import DEFAULTS
from robot.core.values import goal_of
from robot.core.values import Inputs, Scan, Wheels

def drive(navigator):
    params = DEFAULTS._replace(navigator=navigator)
    state = brain.State(params)
    told = []
    for tick in range(1, 400):
        wheels = Wheels(50 * (tick - 1), 48 * (tick - 1), 0, 50 * tick)
        ranges = tuple([abs(900 - (7 * tick + 131 * sonar) % 1800) + 1 for sonar in range(8)])
        scan = Scan(ranges, (5,) * 8, 255, 255)
        _, outputs = brain.step(state, Inputs(50 * tick, wheels, scan, None), params)
        told.append((outputs.left_mrad_s, outputs.right_mrad_s, *state.odometry.pose))
        if tick == 1:
            modes.arm(state.machine)
            goal = goal_of(9000, 500, 0, 0, 50, 50000)
            modes.goto(state.machine, goal, states.AUTO, 50)
    return told
"""


def linked(programs: dict[str, str], constants: dict[Binding, object] | None = None) -> str:
    """Link programs, of which `main` is run."""
    return Program(programs, constants or {}).linked("main")


def run(text: str) -> dict[str, object]:
    """Run a linked program and return its names."""
    names: dict[str, object] = {}
    exec(text, names)
    return names


def test_linked_core_drives_as_the_core() -> None:
    texts = {
        **sources(),
        "main": DRIVE + "\nFOUND = [drive(number) for number in range(1, 7)]\nFOUND\n",
    }
    theirs = run(Program(texts, values(texts)).linked("main"))["FOUND"]
    ours: dict[str, object] = {}
    exec(texts["main"], ours)
    assert theirs == ours["FOUND"]
    assert len(str(theirs)) > 10_000


def test_equal_names_of_two_modules_stay_apart() -> None:
    programs = {
        "one": "def value():\n    return 1\n",
        "two": "def value():\n    return 2\n",
        "main": "import one\nfrom two import value\nRESULT = (one.value(), value())\nRESULT\n",
    }
    assert run(linked(programs))["RESULT"] == (1, 2)


def test_local_name_hides_that_of_a_module() -> None:
    programs = {
        "one": (
            "LIMIT: Final = 3\ndef reach(LIMIT):\n    return LIMIT\ndef most():\n    return LIMIT\n"
        ),
        "main": (
            "import one\n"
            "def f(reach):\n    return one.reach(reach) + one.most()\n"
            "RESULT = f(10)\nRESULT\n"
        ),
    }
    text = linked(programs, {Binding("one", "LIMIT"): 3})
    assert run(text)["RESULT"] == 13
    assert "return 3" in text


def test_constants_become_literals_if_they_are_exact() -> None:
    constants: dict[str, object] = {"A": 7, "B": 0.25, "C": -0.5, "D": (1, 2), "E": True}
    lines = [f"{name}: Final = {value!r}" for name, value in constants.items()]
    programs = {
        "one": "\n".join(lines),
        "main": "from one import A, B, C, D, E\nR = (A, B, C, D, E)\nR\n",
    }
    text = linked(programs, {Binding("one", name): value for name, value in constants.items()})
    assert "R = 7, 0.25, C, (1, 2), E\n" in text
    assert run(text)["R"] == tuple(constants.values())


def test_unused_definitions_are_left_out() -> None:
    programs = {
        "one": "def used():\n    return 1\ndef unused():\n    return 2\n",
        "two": "def never():\n    pass\n",
        "main": "import one, two\ndef f(x: two.never) -> None:\n    one.used()\nf(1)\n",
    }
    text = linked(programs)
    assert "used()" in text
    assert "unused" not in text
    assert "never" not in text


def test_assigned_tuple_has_no_parentheses() -> None:
    assert "a, b = 1, 2\n" in linked({"main": "a, b = 1, 2\nprint(a, b)\n"})


LINE = "static const mp_obj_float_t one = {{&mp_type_float}, (mp_float_t)%s};"


def test_rounded_number_is_replaced_by_its_literal() -> None:
    frozen = LINE % "0.09274918249999999" + LINE % "0.5"
    assert exact(frozen, {0.0927491825, 0.5}) == LINE % "0.0927491825" + LINE % "0.5"


@given(st.floats(1e-30, 1e30))
def test_neighbour_is_replaced_by_the_number(value: float) -> None:
    assert nearest(nextafter(value, 1e300), [value]) == value


def test_number_of_no_literal_is_refused() -> None:
    with pytest.raises(LocalError, match=r"0\.25"):
        exact(LINE % "0.25", {0.5})


def test_number_between_two_literals_is_refused() -> None:
    two = [1.0, nextafter(nextafter(1.0, 2.0), 2.0)]
    with pytest.raises(LocalError):
        nearest(nextafter(1.0, 2.0), two)


def test_literals_of_a_program_are_found() -> None:
    assert floats_in(f"a = 0.1 + 3\nb = ({pi!r}, 'x')\n") == {0.1, pi}


@each(
    ("value", "kept"),
    [
        *((value, True) for value in (3, 0.1, pi, (1, -2), "text")),
        *((value, False) for value in (-0.5, 1e300, True, (), (0.5, pi), [1], ("a",), None)),
    ],
)
def test_only_constants_without_an_operation_become_literals(value: object, kept: bool) -> None:
    assert is_literal(value) is kept


ENTRY = "Types: deb\n# http://old.example/debian\nURIs: http://mirror.example/debian\nSuites: x\n"


def test_build_names_the_missing_compiler(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert main([]) == 2
    told = capsys.readouterr().err
    assert told.startswith("make firmware: ")
    assert "gcc-arm-none-eabi" in told
    assert told.count("\n") == 1


def test_missing_headers_are_named_by_their_packages(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    headers = {tmp_path / package: package for package in build.HEADERS.values()}
    monkeypatch.setattr(build, "HEADERS", headers)
    (tmp_path / "libnewlib-dev").touch()
    assert "libc6-dev" in build.missing_packages()
    assert "libnewlib-dev" not in build.missing_packages()


def test_unknown_variant_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["lpc9"]) == 2
    assert "lpc1768" in capsys.readouterr().err


def test_missing_emulator_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(UserError, match="apt install qemu-system-arm"):
        Emulator(tmp_path / "firmware.elf")


def test_changed_source_of_micropython_is_refused(tmp_path: Path) -> None:
    tarball = tmp_path / build.TARBALL
    tarball.write_bytes(b"something else")
    with pytest.raises(UserError, match="sha256"):
        build.check(tarball)


def test_mirror_of_this_machine_is_used(tmp_path: Path) -> None:
    folder = tmp_path / "sources.list.d"
    folder.mkdir()
    (folder / "debian.sources").write_text(ENTRY)
    assert build.mirror(tmp_path) == "http://mirror.example/debian"


def test_machine_without_a_mirror_is_told_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="build/firmware/source"):
        build.mirror(tmp_path)


def test_image_fits_the_memory_of_the_chip() -> None:
    image = Image()
    assert image.ram_bytes <= 64 * 1024
    assert image.heap_bytes + image.stack_bytes < image.ram_bytes
