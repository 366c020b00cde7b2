from hypothesis import given
from hypothesis import strategies as st

from plant.model.configuration import Fault
from plant.sim.active_faults import NO_TROUBLE, FaultSchedule

S = 10**9


def test_no_fault_gives_no_effect() -> None:
    assert FaultSchedule([]).at(0) is NO_TROUBLE


def test_fault_effects_start_and_end_on_time() -> None:
    schedule = FaultSchedule(
        [Fault("scan_stopped", "", 1.0, 2.0), Fault("ticks_stopped", "", 1.5, 3.0)]
    )
    stopped = [
        (schedule.at(now).scan_stopped, schedule.at(now).ticks_stopped)
        for now in (0, 1 * S - 1, 1 * S, 3 * S // 2, 2 * S, 3 * S)
    ]
    assert stopped == [
        (False, False),
        (False, False),
        (True, False),
        (True, True),
        (False, True),
        (False, False),
    ]


@given(
    st.lists(st.tuples(st.integers(0, 20), st.integers(1, 20)), max_size=5),
    st.lists(st.integers(0, 40), max_size=10).map(sorted),
)
def test_fault_lasts_from_its_start_to_before_its_end(
    spans: list[tuple[int, int]], moments: list[int]
) -> None:
    schedule = FaultSchedule(
        [Fault("scan_stopped", "", start, start + lasting) for start, lasting in spans]
    )
    for now in moments:
        wanted = any(start <= now < start + lasting for start, lasting in spans)
        assert schedule.at(now * S).scan_stopped == wanted


def test_fault_added_while_running_acts_at_once() -> None:
    schedule = FaultSchedule([])
    schedule.at(5 * S)
    schedule.add(Fault("wheel_stuck", "both"))
    assert schedule.at(5 * S).wheel_stuck == (True, True)


def test_clearing_ends_faults_but_keeps_an_encoder_jump() -> None:
    jump, later = (Fault("encoder_jump", "left", start_s, value=7) for start_s in (1.0, 9.0))
    schedule = FaultSchedule([jump, later, Fault("encoder_stuck", "right")])
    assert schedule.at(2 * S).encoder_stuck == (False, True)
    schedule.clear(2 * S)
    assert schedule.at(2 * S) == NO_TROUBLE._replace(jumped_ticks=(7, 0))
    assert schedule.at(10 * S).jumped_ticks == (7, 0)


def test_two_slips_of_one_wheel_combine_below_their_sum() -> None:
    slips = [Fault("wheel_slip", "both", value=0.5), Fault("wheel_slip", "right", value=0.5)]
    assert FaultSchedule(slips).at(0).slip == (0.5, 0.75)


def test_pressed_sectors_are_merged() -> None:
    pressed = [Fault("bumper_stuck", value=1), Fault("bumper_stuck", value=5)]
    assert FaultSchedule(pressed).at(0).bumper == 5


def test_fault_targets_all_sonars_or_one_by_number() -> None:
    faults = [Fault("sonar_fixed", "all", value=1.0), Fault("sonar_fixed", "3", value=2.0)]
    sonar = FaultSchedule([*faults, Fault("sonar_dead", "7")]).at(0).sonar
    assert sonar is not None
    assert sonar.fixed_m == (1.0, 1.0, 1.0, 2.0, 1.0, 1.0, 1.0, 1.0)
    assert sonar.dead == (False,) * 7 + (True,)
    assert not any(sonar.frozen)
