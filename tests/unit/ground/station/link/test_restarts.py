"""A restart is counted once, whichever of its two signs comes first."""

from ground.station.link.processes import Restarts


def test_second_token_is_a_restart() -> None:
    restarts = Restarts()
    assert not restarts.token("a")
    assert not restarts.token("a")
    assert not restarts.token("")
    assert restarts.token("b")
    assert restarts.count == 1


def test_returning_token_is_no_restart() -> None:
    restarts = Restarts()
    for zid in ("a", "", "a"):
        restarts.token(zid)
    assert restarts.count == 0


def test_decreasing_count_is_a_restart() -> None:
    restarts = Restarts()
    found = [restarts.number(number) for number in (1, 2, 3, 0, 1, 0)]
    assert found == [False, False, False, True, False, True]
    assert restarts.count == 2


def test_token_then_count_is_one_restart() -> None:
    restarts = Restarts()
    restarts.token("a")
    restarts.number(9)
    assert restarts.token("b")
    assert not restarts.number(0)
    assert restarts.count == 1


def test_count_then_token_is_one_restart() -> None:
    restarts = Restarts()
    restarts.token("a")
    restarts.number(9)
    assert restarts.number(0)
    assert not restarts.token("b")
    assert restarts.token("c")
    assert restarts.count == 2


def test_reordered_number_is_no_restart() -> None:
    restarts = Restarts(max_late=3)
    assert not any(restarts.number(number) for number in (10, 12, 11, 9, 13, 10))
    assert restarts.number(2)
    assert not restarts.number(3)
    assert restarts.count == 1
