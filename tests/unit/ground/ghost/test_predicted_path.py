"""The output of a ghost process is parsed incrementally, in pieces of any size."""

import json
from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from ground.ghost.branch_point import FAILED, STEP_M, PathReader, PredictedPath, number
from tests.support.each import each

HEAD = b"time_s,true_x_m,true_y_m,more\n"
END = json.dumps(
    {"outcome": "stuck", "reason": "no way", "time_s": 1.5, "path_m": 0.7, "contacts": 2}
).encode()


def run(*places: tuple[float, float]) -> bytes:
    rows = [f"{tick / 20},{x_m},{y_m},0\n" for tick, (x_m, y_m) in enumerate(places)]
    return HEAD + "".join(rows).encode()


def taken(*pieces: bytes) -> PathReader:
    reading = PathReader()
    for piece in pieces:
        reading.take(piece)
    return reading


def test_a_whole_run_is_a_path_and_how_it_ended() -> None:
    reading = taken(run((1.0, 2.0), (1.5, 2.0)) + END + b"\n")
    assert reading.course("") == PredictedPath(
        [(1.0, 2.0), (1.5, 2.0)], "stuck", "no way", 1.5, 0.7, 2
    )


@given(st.lists(st.integers(0, 400), max_size=8))
def test_the_pieces_in_which_it_comes_do_not_matter(cuts: list[int]) -> None:
    whole = run((1.0, 2.0), (1.5, 2.0), (1.5, 2.5)) + END + b"\n"
    places = [0, *sorted(min(cut, len(whole)) for cut in cuts), len(whole)]
    pieces = [whole[a:b] for a, b in pairwise(places)]
    assert taken(*pieces).course("") == taken(whole).course("")


def test_close_points_are_dropped_except_the_last() -> None:
    places = [(1.0 + 0.001 * tick, 2.0) for tick in range(100)]
    driving = taken(run(*places))
    assert len(driving.path_m) <= 0.1 / STEP_M + 1
    driving.take(END + b"\n")
    assert (driving.path_m[0], driving.path_m[-1]) == (places[0], places[-1])


def test_stationary_robot_is_one_point() -> None:
    assert taken(run(*[(1.0, 2.0)] * 50) + END + b"\n").path_m == [(1.0, 2.0)]


def test_without_an_outcome_it_failed_for_the_reason_given() -> None:
    course = taken(run((1.0, 2.0))).course("it was ended")
    assert course == PredictedPath([(1.0, 2.0)], FAILED, "it was ended")


@each(
    "line",
    [
        b"{",
        b"{}",
        b"[1, 2]",
        b'{"outcome": 3}',
        b"{" + b'"a":{' * 100_000,
        b"nonsense",
        b"",
        b"\xff\xfe",
        b"1,2",
        b"1,nan,2",
        b"1,inf,2",
        b"1,x,y",
    ],
)
def test_lines_that_are_none_are_left_out(line: bytes) -> None:
    assert taken(line + b"\n" + run((1.0, 2.0)) + line + b"\n").path_m == [(1.0, 2.0)]
    assert taken(line + b"\n").course("why").outcome == FAILED


@given(st.binary(max_size=200), st.binary(max_size=200))
def test_any_bytes_can_come(before: bytes, after: bytes) -> None:
    assert isinstance(taken(before, run((1.0, 2.0)), after, END, b"\n").course(""), PredictedPath)


@each(("value", "found"), [(1, 1.0), (2.5, 2.5), (None, None), ("3", None), (float("nan"), None)])
def test_what_is_no_number_is_missing(value: object, found: float | None) -> None:
    assert number(value) == found
