from tests.support.each import each
from tests.support.plant.world_texts import Bad, assert_told, more, with_line

BAD = [
    Bad(
        "a typo in robot",
        more("[robot]\nradus_m = 0.1\n"),
        21,
        "robot.radus_m",
        "unknown key",
        "did you mean radius_m?",
    ),
    Bad(
        "a robot in centimetres",
        more("[robot]\nradius_cm = 12\n"),
        21,
        "robot.radius_cm",
        "wrong unit",
        "did you mean radius_m = 0.12?",
    ),
    Bad(
        "a robot of nothing",
        more("[robot]\nwheel_radius_m = 0\n"),
        21,
        "robot.wheel_radius_m",
        "must be above zero",
        "a value such as wheel_radius_m = 0.033",
    ),
    Bad(
        "wheels beside the robot",
        more("[robot]\nradius_m = 0.05\n"),
        20,
        "robot.track_m",
        "wider than the robot",
        "set track_m too, to fit radius_m",
    ),
    Bad(
        "half a tick",
        more("[robot]\nleft_start_ticks = 0.5\n"),
        21,
        "robot.left_start_ticks",
        "expected a whole number",
        "left_start_ticks = 0",
    ),
    Bad(
        "a word as robot",
        with_line(5, 'robot = "r2"'),
        5,
        "robot",
        "expected a table",
        "write { radius_m",
    ),
    Bad(
        "a level nobody knows",
        more('[noise]\nlevel = "loud"\n'),
        21,
        "noise.level",
        "no noise level 'loud'; there are none, default, lossy, harsh",
        'level = "default"',
    ),
    Bad(
        "more than certain",
        more("[noise]\ndropout_probability = 1.5\n"),
        21,
        "noise.dropout_probability",
        "1.5 is not within 0 to 1",
        "dropout_probability = 0",
    ),
    Bad(
        "noise in radians",
        more("[noise]\nincidence_limit_rad = 0.5\n"),
        21,
        "noise.incidence_limit_rad",
        "wrong unit",
        "did you mean incidence_limit_deg = 28.6479?",
    ),
    Bad(
        "a fault without kind",
        more('[[fault]]\ntarget = "3"\n'),
        20,
        "fault#1.kind",
        "missing",
        'add kind = "sonar_dead"',
    ),
    Bad(
        "a fault nobody knows",
        more('[[fault]]\nkind = "gremlin"\n'),
        21,
        "fault#1.kind",
        "no fault 'gremlin'; there are sonar_dead",
        'kind = "sonar_dead"',
    ),
    Bad(
        "the ninth sonar",
        more('[[fault]]\nkind = "sonar_dead"\ntarget = "8"\n'),
        22,
        "fault#1.target",
        "'8' is none of",
        'target = "3"',
    ),
    Bad(
        "one fault",
        more('[fault]\nkind = "sonar_dead"\n'),
        20,
        "fault",
        "a table",
        "write [[fault]]",
    ),
]


@each("bad", BAD)
def test_impossible_robot_noise_or_fault_is_rejected(bad: Bad) -> None:
    assert_told(bad, alone=True)
