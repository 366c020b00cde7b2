"""A restart is counted once, whichever of its signs comes first."""

from ground.station.link.restarts import Restarts


def test_the_first_token_is_no_restart_and_the_next_one_is() -> None:
    restarts = Restarts()
    assert not restarts.token("a")
    assert not restarts.token("a")
    assert not restarts.token("")
    assert restarts.token("b")
    assert restarts.count == 1


def test_a_token_that_comes_back_after_an_outage_is_the_same_process() -> None:
    restarts = Restarts()
    for zid in ("a", "", "a"):
        restarts.token(zid)
    assert restarts.count == 0


def test_a_count_that_goes_back_is_a_restart_where_there_are_no_tokens() -> None:
    restarts = Restarts()
    found = [restarts.number(number) for number in (1, 2, 3, 0, 1, 0)]
    assert found == [False, False, False, True, False, True]
    assert restarts.count == 2


def test_token_then_count_count_once() -> None:
    restarts = Restarts()
    restarts.token("a")
    restarts.number(9)
    assert restarts.token("b")
    assert not restarts.number(0)
    assert restarts.count == 1


def test_count_then_token_count_once_and_the_next_restart_again() -> None:
    restarts = Restarts()
    restarts.token("a")
    restarts.number(9)
    assert restarts.number(0)
    assert not restarts.token("b")
    assert restarts.token("c")
    assert restarts.count == 2


def test_a_number_that_was_overtaken_on_its_way_is_no_restart_and_one_far_behind_is() -> None:
    restarts = Restarts(max_late=3)
    assert not any(restarts.number(number) for number in (10, 12, 11, 9, 13, 10))
    assert restarts.number(2)
    assert not restarts.number(3)
    assert restarts.count == 1
