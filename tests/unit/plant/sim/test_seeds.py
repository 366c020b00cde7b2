import numpy as np
import pytest
from mpmath import mp, mpf

from plant.sim.seeds import BLOCK_ROWS, gaussian, gaussian_rows, stream, uniform, uniform_rows
from tests.support.each import each

KNOWN_BITS = ["0x9cff3c4b42a8a30a", "0x8d50759baa10401e"]
KNOWN_UNIFORM = ["0x1.39fe789685514p-1", "0x1.1aa0eb3754208p-1"]
KNOWN_GAUSSIAN = [
    *("-0x1.996b02eb6f1bbp-1", "-0x1.da8cd6d22a61ap-1"),
    *("0x1.3b2857f9ae312p+0", "0x1.21c5c1919a87cp+0"),
]


def test_same_names_give_the_same_numbers() -> None:
    assert stream(5, 0, "slip").random_raw() == stream(5, 0, "slip").random_raw()


@each("other", [(6, 0, "slip"), (5, 1, "slip"), (5, 0, "sonar range")])
def test_seed_robot_and_source_each_change_the_numbers(other: tuple[int, int, str]) -> None:
    assert stream(5, 0, "slip").random_raw() != stream(*other).random_raw()


def test_reading_one_source_does_not_shift_another() -> None:
    alone = [uniform_rows(1, 0, "a", 2).next() for _ in range(1)]
    greedy, mixed = uniform_rows(1, 0, "b", 8), uniform_rows(1, 0, "a", 2)
    for _ in range(3 * BLOCK_ROWS):
        greedy.next()
    assert [mixed.next()] == alone


def test_rows_continue_in_order_across_blocks() -> None:
    rows = uniform_rows(3, 2, "x", 4)
    read = [number for _ in range(2 * BLOCK_ROWS) for number in rows.next()]
    assert read == uniform(stream(3, 2, "x").random_raw(8 * BLOCK_ROWS)).tolist()


def test_bits_and_numbers_are_the_known_ones() -> None:
    """Pinned: neither numpy, nor the C library, nor the processor may change them."""
    assert [hex(one) for one in stream(1, 0, "slip").random_raw(2).tolist()] == KNOWN_BITS
    assert [one.hex() for one in uniform_rows(1, 0, "slip", 2).next()] == KNOWN_UNIFORM
    rows = gaussian_rows(1, 0, "slip", 2)
    assert [one.hex() for _ in range(2) for one in rows.next()] == KNOWN_GAUSSIAN


def test_gaussian_numbers_match_their_definition() -> None:
    bits = stream(4, 0, "x").random_raw(400)
    numbers = gaussian(bits).tolist()
    for k in range(200):
        u = ((int(bits[k]) >> 11) + 1) * mpf(2) ** -53
        v = (int(bits[200 + k]) >> 11) * mpf(2) ** -53
        turn = (v - 0.5) * mp.pi / 2 + (int(bits[200 + k]) & 3) * mp.pi / 2
        length = mp.sqrt(-2 * mp.log(u))
        assert numbers[k] == pytest.approx(float(length * mp.cos(turn)), rel=1e-13, abs=1e-15)
        assert numbers[200 + k] == pytest.approx(float(length * mp.sin(turn)), rel=1e-13, abs=1e-15)


def test_extreme_bits_give_finite_numbers() -> None:
    most = 2**64 - 1
    bits = np.array([0, most, 0, most, 0, 0, most, most], dtype=np.uint64)
    assert np.isfinite(gaussian(bits)).all()
    assert np.abs(gaussian(bits)).max() < 8.6
    assert uniform(bits).min() == 0.0
    assert uniform(bits).max() == 1.0 - 2.0**-53


def test_gaussian_numbers_are_standard_normal() -> None:
    numbers = gaussian(stream(2, 0, "x").random_raw(200_000))
    assert numbers.mean() == pytest.approx(0.0, abs=0.01)
    assert numbers.std() == pytest.approx(1.0, abs=0.01)
    assert (numbers**4).mean() == pytest.approx(3.0, abs=0.1)
    halves = numbers.reshape(2, -1)
    assert (halves[0] * halves[1]).mean() == pytest.approx(0.0, abs=0.02)
    for sigmas, share in ((1.0, 0.6827), (2.0, 0.9545), (3.0, 0.9973)):
        assert (np.abs(numbers) < sigmas).mean() == pytest.approx(share, abs=0.005)


def test_negative_seed_is_rejected() -> None:
    with pytest.raises(ValueError, match=r"^seed: -1 is negative"):
        stream(-1, 0, "slip")
