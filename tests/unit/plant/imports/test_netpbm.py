from contextlib import suppress

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from plant.imports.ros_map import parse_pgm
from plant.model.errors import WorldError
from tests.support.each import each
from tests.support.plant.imports.files import P2, P5, ROWS, refused


def test_text_and_binary_pictures_are_equal() -> None:
    expected = np.array(ROWS) / 255
    assert np.allclose(parse_pgm(P5, "x.pgm"), expected)
    assert np.allclose(parse_pgm(P2, "x.pgm"), expected)


def test_largest_value_is_white() -> None:
    assert parse_pgm(b"P2 3 1 4 0 2 4", "x.pgm").tolist() == [[0.0, 0.5, 1.0]]


def test_values_above_255_are_big_endian_16_bit() -> None:
    assert parse_pgm(b"P5 2 1 1000 \x03\xe8\x01\xf4", "x.pgm").tolist() == [[1.0, 0.5]]


def test_comments_may_appear_anywhere_before_the_pixels() -> None:
    data = b"P5 # one\n#two\n 2 # three\n1\n#four\n255\n\x00\xff"
    assert parse_pgm(data, "x.pgm").tolist() == [[0.0, 1.0]]
    assert parse_pgm(b"P2\n2 1\n1\n0 # a comment\n1\n", "x.pgm").tolist() == [[0.0, 1.0]]


def test_pixel_may_have_the_value_of_a_blank() -> None:
    assert parse_pgm(b"P5 2 1 255\n\n\n", "x.pgm").shape == (1, 2)
    assert parse_pgm(b"P5 1 1 255\n \n", "x.pgm").shape == (1, 1)


BAD = [
    (b"", "format", "empty"),
    (b"P5", "format", "starts with b'P5'"),
    (b"P55 1 1 255 x", "format", "starts with"),
    (b"P6 1 1 255 abc", "format", "a PPM picture (colours)"),
    (b"P4 8 1 x", "format", "a PBM picture"),
    (b"\x89PNG\r\n\x1a\n", "format", "a PNG picture"),
    (b"\xff\xd8\xff\xe0", "format", "a JPEG picture"),
    (b"hello", "format", "starts with b'hello'"),
    (b"P5 ", "width", "the file ends"),
    (b"P5 0 1 255 ", "width", "'0'"),
    (b"P5 -3 1 255 ", "width", "'-3'"),
    (b"P5 3.5 1 255 ", "width", "'3.5'"),
    (b"P5 99999999999 1 255 ", "width", "'99999999999'"),
    (b"P5 3", "height", "the file ends"),
    (b"P5 3 # 4 5", "height", "the file ends"),
    (b"P5 3 1 0 abc", "maxval", "'0'"),
    (b"P5 3 1 65536 abc", "maxval", "'65536'"),
    (b"P5 3 1 255", "raster", "missing"),
    (b"P5 3 1 255\nab", "raster", "2 bytes, but width times height needs 3"),
    (b"P5 3 1 255\nabcd", "raster", "4 bytes, but width times height needs 3"),
    (b"P5 2 1 256\nabc", "raster", "3 bytes, but width times height needs 4"),
    (b"P5 2 1 100\nab\xff", "raster", "3 bytes"),
    (b"P5 2 1 100\na\xff", "raster", "a value of 255, but maxval is 100"),
    (b"P2 3 1 255 1 2", "raster", "2 numbers, but width times height needs 3"),
    (b"P2 2 1 255 1 2 3", "raster", "3 numbers"),
    (b"P2 2 1 255 1 x", "raster", "'x' is no whole number"),
    (b"P2 2 1 255 1 -2", "raster", "'-2' is no whole number"),
    (b"P2 2 1 255 1 256", "raster", "a value of 256, but maxval is 255"),
]


@each(("data", "key", "reason"), BAD)
def test_invalid_picture_is_rejected_by_key(data: bytes, key: str, reason: str) -> None:
    problem = refused(lambda: parse_pgm(data, "bad.pgm"))
    assert (problem.file, problem.key) == ("bad.pgm", key)
    assert reason in problem.reason


@settings(max_examples=500)
@given(st.sampled_from((P2, P5)), st.integers(0, 90), st.binary(max_size=12), st.booleans())
def test_damaged_picture_is_read_or_rejected(good: bytes, at: int, noise: bytes, cut: bool) -> None:
    data = good[:at] + noise + (b"" if cut else good[at:])
    try:
        found = parse_pgm(data, "x.pgm")
    except WorldError:
        return
    assert found.ndim == 2
    assert ((found >= 0.0) & (found <= 1.0)).all()


@settings(max_examples=300)
@given(st.binary(max_size=40))
def test_any_bytes_raise_only_import_errors(noise: bytes) -> None:
    for data in (noise, b"P5 " + noise, b"P2 3 2 " + noise):
        with suppress(WorldError):
            assert parse_pgm(data, "x.pgm").size > 0


@given(st.integers(1, 6), st.integers(1, 6), st.integers(1, 65535), st.data())
def test_written_picture_is_read_back(
    width: int, height: int, most: int, data: st.DataObject
) -> None:
    values = data.draw(
        st.lists(st.integers(0, most), min_size=width * height, max_size=width * height)
    )
    head = f"{width} {height} {most}\n"
    raw = np.array(values, dtype=">u1" if most < 256 else ">u2").tobytes()
    expected = np.array(values).reshape(height, width) / most
    assert (parse_pgm(b"P5 " + head.encode() + raw, "x") == expected).all()
    text = f"P2 {head}" + " ".join(str(value) for value in values)
    assert (parse_pgm(text.encode(), "x") == expected).all()
