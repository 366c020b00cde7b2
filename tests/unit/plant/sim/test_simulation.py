from dataclasses import replace
from math import cos, pi, radians, sin

import pytest

from plant.model.configuration import LEVELS, Noise
from plant.sim.simulation import Plant
from protocol.wire.codec import Encoder, decode
from protocol.wire.messages import SonarScan, WheelTicks
from protocol.world import Circle, World
from tests.support.each import each
from tests.support.plant.rooms import FOREVER_NS, NONE, counters, drive, mrad_s, ranges_m, room

TICK_NS = 50_000_000
AT_ONCE = {"motor_lag_s": 0.0, "max_acceleration_m_s2": 1e6}
FOREST = room(
    *(Circle(x_m=0.5 + 0.7 * i, y_m=0.5 + 0.7 * j, radius_m=0.1) for i in range(5) for j in (0, 3)),
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
    roller = Circle(x_m=3.5, y_m=2.0, radius_m=0.3, path_m=((3.5, 2.0), (1.5, 2.0)), speed_m_s=0.2)
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
    roller = Circle(x_m=3.5, y_m=2.0, radius_m=0.3, path_m=path, speed_m_s=1.0)
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
