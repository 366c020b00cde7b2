"""The simulation: its state, seeds, score and faults."""

from dataclasses import replace
from hashlib import sha256
from math import cos, inf, pi, radians, sin
from struct import pack

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mpmath import mp, mpf

from plant.model.configuration import KINDS, LEVELS, Fault, Noise
from plant.sim import simulation as score_module
from plant.sim.active_faults import NO_TROUBLE, FaultSchedule
from plant.sim.seeds import BLOCK_ROWS, gaussian, gaussian_rows, stream, uniform, uniform_rows
from plant.sim.simulation import Plant, Score
from protocol.wire.codec import Encoder, decode
from protocol.wire.messages import SonarScan, WheelTicks
from protocol.world import World, WorldCircle
from runtime.units import NS_PER_S as S
from runtime.units import PERIOD_NS as TICK_NS
from tests.support.each import each
from tests.support.plant import (
    FOREVER_NS,
    NONE,
    bumper,
    counters,
    drive,
    mrad_s,
    ranges_m,
    room,
)

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


def plant(*faults: Fault) -> Plant:
    return Plant(room(), 1, NONE, faults)


@each("kind", sorted(KINDS))
def test_every_fault_takes_effect_and_ends(kind: str) -> None:
    spec = KINDS[kind]
    fault = Fault(kind, spec.targets[-1], 0.5, 1.0, spec.highest)
    sound, faulty = plant(), plant(fault)
    differs = []
    for _ in range(30):
        drive(sound, 0.2, 0.1, 1)
        drive(faulty, 0.2, 0.1, 1)
        differs.append(sound.senses() != faulty.senses() or sound.truth() != faulty.truth())
    assert not any(differs[:9])
    assert any(differs[9:20])
    lasting = {"encoder_stuck", "encoder_jump", "wheel_slip", "wheel_stuck"}
    assert differs[-1] == (kind in lasting)


@each(("kind", "index"), [("ticks_stopped", 0), ("scan_stopped", 1)])
def test_stopped_senses_are_none_and_resume(kind: str, index: int) -> None:
    one = plant(Fault(kind, "", 0.1, 0.2))
    missing = []
    for _ in range(6):
        senses = one.senses()
        missing.append(senses[index] is None)
        assert senses[1 - index] is not None
        one.advance()
    assert missing == [False, False, True, True, False, False]


def test_fault_may_be_active_from_the_start() -> None:
    assert plant(Fault("scan_stopped")).senses()[1] is None


def test_stuck_bumper_is_pressed_without_a_contact() -> None:
    one = plant(Fault("bumper_stuck", value=5))
    assert bumper(one) == 5
    one.advance()
    assert one.truth().contact == 0


def test_encoder_jumps_once() -> None:
    one = plant(Fault("encoder_jump", "left", 0.1, inf, 5000))
    left = []
    for _ in range(4):
        left.append(counters(one)[0])
        one.advance()
    assert left == [0, 0, 5000, 5000]


def test_stuck_wheel_turns_the_robot() -> None:
    one = plant(Fault("wheel_stuck", "left"))
    drive(one, 0.2, 0.2, 20)
    assert one.truth().heading_rad > 0.5
    assert counters(one)[0] == 0


def test_encoder_does_not_measure_wheel_slip() -> None:
    one = plant(Fault("wheel_slip", "right", value=0.5))
    drive(one, 0.2, 0.2, 20)
    assert one.truth().heading_rad < -0.3
    assert counters(one)[0] == counters(one)[1]


def test_injected_fault_acts_from_the_next_period_until_cleared() -> None:
    one = plant()
    one.inject(Fault("sonar_dropout", "all", value=1.0))
    assert ranges_m(one)[0] is not None
    one.advance()
    assert ranges_m(one) == [None] * 8
    one.clear_faults()
    one.advance()
    assert ranges_m(one)[0] is not None


def test_fault_affects_only_its_robot() -> None:
    pair = Plant(room(), 1, NONE, [Fault("scan_stopped", robot=1)], robots=2)
    assert pair.senses(0)[1] is not None
    assert pair.senses(1)[1] is None


def test_fault_of_an_absent_robot_is_rejected() -> None:
    with pytest.raises(ValueError, match=r"^robot: 1 has a fault"):
        plant(Fault("scan_stopped", robot=1))
    with pytest.raises(ValueError, match=r"^robot: 2 has a fault"):
        plant().inject(Fault("scan_stopped", robot=2))


def test_fault_does_not_shift_other_noise() -> None:
    """Leave the readings of the other sonars unchanged by a fault of one."""
    sound = Plant(room(), 4, LEVELS["harsh"])
    faulty = Plant(room(), 4, LEVELS["harsh"], [Fault("sonar_dropout", "0", value=0.5)])
    for _ in range(50):
        drive(sound, 0.2, 0.2, 1)
        drive(faulty, 0.2, 0.2, 1)
        assert ranges_m(sound)[1:] == ranges_m(faulty)[1:]


AT_ONCE = {"motor_lag_s": 0.0, "max_acceleration_m_s2": 1e6}
FOREST = room(
    *(
        WorldCircle(x_m=0.5 + 0.7 * i, y_m=0.5 + 0.7 * j, radius_m=0.1)
        for i in range(5)
        for j in (0, 3)
    ),
    start=(0.5, 1.6, 0.3),
)


def wander(world: World, seed: int, noise: Noise, ticks: int = 200) -> Plant:
    """Drive with commands that depend on the sensors, so that any difference accumulates."""
    plant = Plant(world, seed, noise)
    for _ in range(ticks):
        near_m = min((range_m for range_m in ranges_m(plant) if range_m is not None), default=3.0)
        drive(plant, 0.25, 0.25 if near_m > 0.4 else -0.1, 1)
    return plant


def test_tick_0_precedes_any_motion() -> None:
    plant = Plant(room(), 1, NONE)
    ticks, scan = plant.senses()
    assert ticks is not None
    assert scan is not None
    assert (ticks.time_ns, ticks.seq, scan.seq, counters(plant)) == (0, 0, 0, (0, 0))
    truth = plant.truth()
    assert (truth.x_m, truth.y_m, truth.heading_rad, truth.speed_m_s) == (1.0, 2.0, 0.0, 0.0)
    assert plant.score(FOREVER_NS).ticks == 0


def test_each_period_advances_the_stamp() -> None:
    plant = Plant(room(), 1, NONE)
    for seq in range(1, 4):
        plant.advance()
        ticks, scan = plant.senses()
        assert ticks is not None
        assert scan is not None
        assert (ticks.time_ns, scan.time_ns, plant.truth().time_ns) == (seq * TICK_NS,) * 3
        assert (ticks.seq, scan.seq, plant.truth().seq) == (seq, seq, seq)


def test_reading_senses_twice_gives_the_same_values() -> None:
    plant = Plant(room(), 1, LEVELS["harsh"])
    plant.advance()
    assert plant.senses() == plant.senses()


def test_all_senses_fit_their_wire_fields() -> None:
    encoder, plant = Encoder(1, 1), Plant(FOREST, 1, LEVELS["harsh"])
    for _ in range(100):
        drive(plant, 0.3, 0.25, 1)
        for message in (*plant.senses(), plant.truth(), plant.score(FOREVER_NS)):
            assert message is not None
            decoded = decode(encoder.encode(message)).message
            assert message == decoded or not isinstance(message, WheelTicks | SonarScan)


@each(
    ("left_m_s", "right_m_s"), [(0.29, 0.29), (0.1, 0.29), (0.29, 0.25), (-0.2, 0.2), (-0.29, -0.1)]
)
def test_free_motion_follows_the_exact_arc(left_m_s: float, right_m_s: float) -> None:
    start = (20.0, 20.0, 0.4)
    plant = Plant(room(start=start, size_m=(40.0, 40.0), robot=AT_ONCE), 1, NONE)
    left_m_s, right_m_s = (mrad_s(speed) * 0.033e-3 for speed in (left_m_s, right_m_s))
    speed_m_s, yaw_rad_s = (left_m_s + right_m_s) / 2.0, (right_m_s - left_m_s) / 0.20
    for tick in range(1, 201):
        drive(plant, left_m_s, right_m_s, 1)
        turned_rad = yaw_rad_s * tick * 0.05
        if turned_rad:
            radius_m = speed_m_s / yaw_rad_s
            x_m = start[0] + radius_m * (sin(start[2] + turned_rad) - sin(start[2]))
            y_m = start[1] - radius_m * (cos(start[2] + turned_rad) - cos(start[2]))
        else:
            x_m = start[0] + speed_m_s * tick * 0.05 * cos(start[2])
            y_m = start[1] + speed_m_s * tick * 0.05 * sin(start[2])
        truth = plant.truth()
        assert (truth.x_m, truth.y_m) == pytest.approx((x_m, y_m), abs=1e-6)
        error_rad = truth.heading_rad - start[2] - turned_rad
        assert (error_rad + pi) % (2.0 * pi) - pi == pytest.approx(0.0, abs=1e-6)
        assert abs(truth.heading_rad) <= pi
    assert truth.yaw_rate_rad_s == pytest.approx(yaw_rad_s, abs=1e-9)
    assert abs(truth.speed_m_s) == pytest.approx(abs(speed_m_s), rel=0.01)
    assert truth.speed_m_s * speed_m_s >= 0.0


def test_wheels_stop_within_200_ms_when_commands_stop() -> None:
    plant = Plant(room(), 1, NONE)
    drive(plant, 0.3, 0.3, 20)
    for _ in range(3):
        plant.advance()
    stopped_at_m = [plant.truth().x_m]
    for _ in range(3):
        plant.advance()
        stopped_at_m.append(plant.truth().x_m)
    ticks = plant.senses()[0]
    assert ticks is not None
    assert ticks.expired == 1
    assert stopped_at_m[1] == stopped_at_m[2] == stopped_at_m[3]
    drive(plant, 0.3, 0.3, 1)
    ticks = plant.senses()[0]
    assert ticks is not None
    assert ticks.expired == 0


def test_encoders_measure_the_distance_without_noise() -> None:
    plant = Plant(room(), 1, NONE)
    drive(plant, 0.3, 0.3, 100)
    way_m = plant.truth().x_m - 1.0
    assert counters(plant) == (int(way_m * 5000.0),) * 2


def test_early_sonars_use_the_pose_half_a_period_ago() -> None:
    plant = Plant(room(start=(0.5, 2.0, 0.0)), 1, NONE)
    drive(plant, 0.3, 0.3, 40)
    odd_m, even_m = ranges_m(plant)[3], ranges_m(plant)[4]
    assert odd_m is not None
    assert even_m is not None
    scan = plant.senses()[1]
    assert scan is not None
    assert scan.ping_age_us == (25_000, 0) * 4
    assert even_m - odd_m == pytest.approx(0.3 * 0.025 / cos(radians(2.25)), abs=0.0011)


def test_approaching_obstacle_gives_shrinking_ranges() -> None:
    roller = WorldCircle(
        x_m=3.5, y_m=2.0, radius_m=0.3, path_m=((3.5, 2.0), (1.5, 2.0)), speed_m_s=0.2
    )
    plant = Plant(room(roller, start=(1.3, 2.0, 0.0)), 1, NONE)
    far_m = ranges_m(plant)[3]
    for _ in range(100):
        plant.advance()
    near_m = ranges_m(plant)[3]
    assert far_m is not None
    assert near_m is not None
    assert far_m - near_m == pytest.approx(0.2 * 5.0, abs=0.02)
    assert plant.truth().clearance_m == pytest.approx(2.5 - 1.3 - 0.3 - 0.12, abs=1e-9)


def test_early_sonars_use_obstacle_positions_half_a_period_ago() -> None:
    path = ((3.5, 2.0), (1.5, 2.0))
    roller = WorldCircle(x_m=3.5, y_m=2.0, radius_m=0.3, path_m=path, speed_m_s=1.0)
    plant = Plant(room(roller), 1, NONE)
    for _ in range(5):
        plant.advance()
    late_m, early_m = ranges_m(plant)[3:5]
    assert late_m is not None
    assert early_m is not None
    assert early_m - late_m == pytest.approx(1.0 * 0.025, abs=0.0015)


def test_robots_detect_each_other_and_drive_independently() -> None:
    plant = Plant(room(start=(2.0, 1.5, pi / 2)), 1, NONE, robots=2)
    assert plant.truth(0).clearance_m == plant.truth(1).clearance_m == pytest.approx(0.36)
    assert ranges_m(plant, 0)[7] == pytest.approx(0.36, abs=0.005)
    assert ranges_m(plant, 1)[0] == pytest.approx(0.36, abs=0.005)
    drive(plant, 0.3, 0.3, 20, robot=1)
    assert (plant.truth(0).y_m, counters(plant, 0)) == (1.5, (0, 0))
    assert plant.truth(1).y_m > 1.75
    assert plant.score(FOREVER_NS, 0).path_m < 1e-9 < plant.score(FOREVER_NS, 1).path_m


def test_each_robot_has_its_own_noise() -> None:
    world = room(start=(2.0, 2.0, 0.0))
    three = Plant(world, 1, LEVELS["default"], robots=3)
    ahead_m = [ranges_m(three, robot)[2:6] for robot in range(3)]
    assert len({tuple(ranges) for ranges in ahead_m}) == 3
    assert ranges_m(Plant(world, 1, LEVELS["default"]))[2:6] == ahead_m[0]


@each("level", list(LEVELS))
def test_same_seed_gives_a_bit_identical_drive(level: str) -> None:
    one, two = (wander(FOREST, 5, LEVELS[level]) for _ in range(2))
    assert one.score(FOREVER_NS) == two.score(FOREVER_NS)
    assert one.senses() == two.senses()


def test_different_seed_gives_a_different_drive() -> None:
    one, two = (wander(FOREST, seed, LEVELS["default"]) for seed in (5, 6))
    assert one.score(FOREVER_NS).digest != two.score(FOREVER_NS).digest


def test_seed_has_no_effect_without_noise() -> None:
    one, two = (wander(FOREST, seed, NONE) for seed in (5, 6))
    assert one.score(FOREVER_NS).digest == two.score(FOREVER_NS).digest


def test_score_restarts_on_request() -> None:
    plant = Plant(room(), 1, NONE)
    drive(plant, 0.3, 0.3, 40)
    plant.restart_score()
    start_m = plant.truth().x_m
    drive(plant, 0.3, 0.3, 10)
    score = plant.score(FOREVER_NS)
    assert (score.ticks, score.time_ns) == (10, plant.now_ns)
    assert score.path_m == pytest.approx(plant.truth().x_m - start_m)


def test_world_may_override_the_robot() -> None:
    world = room(robot={"radius_m": 0.2, "track_m": 0.3, "left_start_ticks": 2**31 - 1})
    plant = Plant(world, 1, NONE)
    assert plant.truth().clearance_m == pytest.approx(0.8)
    drive(plant, 0.3, 0.3, 2)
    assert counters(plant)[0] < 0 < counters(plant)[1]


def test_empty_floor_without_walls_gives_no_echo() -> None:
    plant = Plant(replace(room(), walls=False), 1, LEVELS["lossy"])
    seen = 0
    for _ in range(50):
        drive(plant, 0.3, 0.3, 1)
        seen += sum(range_m is not None for range_m in ranges_m(plant))
    assert seen < 5  # ghosts


START_NS = 3 * TICK_NS


def square_run() -> Score:
    """Drive five ticks around a 1 m square: contacts in ticks 2 and 3, run into in tick 5."""
    score = Score(START_NS, 0.0, 0.0, 0.0, 0.9)
    score.add(1.0, 0.0, 0.1, 0.5, touching=False)
    score.add(1.0, 1.0, 0.2, -0.001, touching=True)
    score.add(0.0, 1.0, 0.3, 0.0, touching=True, closing=True)
    score.add(0.0, 0.0, 0.4, 0.3, touching=False)
    score.add(0.0, 0.0, 0.4, 0.0, touching=True, closing=True)
    return score


def test_unfinished_run_is_scored_up_to_now() -> None:
    whole = square_run().until(10**18)
    assert (whole.ticks, whole.time_ns, whole.contacts) == (5, START_NS + 5 * TICK_NS, 2)
    assert (whole.x_m, whole.y_m, whole.heading_rad) == (0.0, 0.0, 0.4)
    assert (whole.path_m, whole.min_clearance_m) == (4.0, -0.001)


def test_score_ends_at_the_requested_tick() -> None:
    cut = square_run().until(START_NS + 1 * TICK_NS)
    assert (cut.ticks, cut.contacts, cut.x_m, cut.path_m) == (1, 0, 1.0, 1.0)
    assert cut.min_clearance_m == 0.5
    between = square_run().until(START_NS + 2 * TICK_NS - 1)
    assert between == cut


def test_score_at_the_start_has_no_ticks_but_a_clearance() -> None:
    start = square_run().until(0)
    assert (start.ticks, start.time_ns, start.min_clearance_m) == (0, START_NS, 0.9)
    assert bytes(start.digest) == sha256().digest()


def test_digest_covers_stamps_and_true_poses() -> None:
    poses = [(1.0, 0.0, 0.1), (1.0, 1.0, 0.2)]
    wanted = sha256()
    for tick, pose in enumerate(poses, start=1):
        wanted.update(pack("<Qddd", START_NS + tick * TICK_NS, *pose))
    assert bytes(square_run().until(START_NS + 2 * TICK_NS).digest) == wanted.digest()


def test_digest_does_not_depend_on_saved_hash_states(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Saved states keep the cost of a score constant in runs of many hours."""
    monkeypatch.setattr(score_module, "HASHED", 4)
    run, wanted = Score(START_NS, 0.0, 0.0, 0.0, 1.0), [sha256()]
    for tick in range(1, 15):
        pose = (0.1 * tick, -0.2 * tick, 0.01 * tick)
        run.add(*pose, 1.0, touching=False)
        wanted.append(wanted[-1].copy())
        wanted[-1].update(pack("<Qddd", START_NS + tick * TICK_NS, *pose))
    for tick in (14, 3, 4, 5, 0, 8, 12, 11):
        digest = bytes(run.until(START_NS + tick * TICK_NS).digest)
        assert digest == wanted[tick].digest(), tick


def test_lasting_touch_is_one_contact_wherever_the_run_is_cut() -> None:
    run = square_run()
    assert [run.until(START_NS + tick * TICK_NS).contacts for tick in range(6)] == [
        *(0, 0, 1, 1, 1, 2)
    ]


def test_contact_is_the_robots_if_it_approached_at_first_touch() -> None:
    run = square_run()
    assert [run.until(START_NS + tick * TICK_NS).own_contacts for tick in range(6)] == [
        *(0, 0, 0, 0, 0, 1)
    ]


def test_full_score_no_longer_changes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(score_module, "MAX_TICKS", 5)
    run = square_run()
    assert run.ticks == 5
    before = run.until(10**18)
    run.add(9.0, 9.0, 0.0, -1.0, touching=False)
    assert run.until(10**18) == before
