import pytest

from plant.sim.seeds import BLOCK_ROWS, gaussian_rows, stream, uniform_rows


def test_same_names_give_the_same_numbers() -> None:
    assert stream(5, 0, "slip").random() == stream(5, 0, "slip").random()


@pytest.mark.parametrize("other", [(6, 0, "slip"), (5, 1, "slip"), (5, 0, "sonar range")])
def test_seed_robot_and_source_each_change_the_numbers(other: tuple[int, int, str]) -> None:
    assert stream(5, 0, "slip").random() != stream(*other).random()


def test_reading_one_source_does_not_shift_another() -> None:
    alone = [uniform_rows(1, 0, "a", 2).next() for _ in range(1)]
    greedy, mixed = uniform_rows(1, 0, "b", 8), uniform_rows(1, 0, "a", 2)
    for _ in range(3 * BLOCK_ROWS):
        greedy.next()
    assert [mixed.next()] == alone


def test_rows_continue_in_order_across_blocks() -> None:
    rows = gaussian_rows(3, 2, "x", 4)
    read = [rows.next() for _ in range(2 * BLOCK_ROWS)]
    assert read == stream(3, 2, "x").standard_normal((2 * BLOCK_ROWS, 4)).tolist()


def test_negative_seed_is_rejected() -> None:
    with pytest.raises(ValueError, match=r"^seed: -1 is negative"):
        stream(-1, 0, "slip")
