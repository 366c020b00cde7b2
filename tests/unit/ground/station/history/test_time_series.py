"""Series over time are bounded, and thinning keeps the extremes."""

from math import isnan

from ground.station.history.time_series import SERIES, Series, SeriesTable


def test_last_minute_is_kept_in_full() -> None:
    series = Series()
    for tick in range(1200):
        series.add(tick / 20, float(tick))
    assert len(series.points()) == 1200
    assert series.last == (1199 / 20, 1199.0)


def test_older_points_keep_extremes_per_half_second() -> None:
    series = Series(full=20)
    for tick in range(2000):
        series.add(tick / 20, 100.0 if tick == 777 else -5.0 if tick == 778 else 1.0)
    values = [value for _, value in series.points()]
    assert 100.0 in values
    assert -5.0 in values
    assert len(values) < 20 + 2 * 200 + 2


def test_times_never_decrease() -> None:
    series = Series(full=20)
    for tick in range(999):
        series.add(tick / 20, float(tick % 7))
    times = [time_s for time_s, _ in series.points()]
    assert times == sorted(times)


def test_ten_minutes_at_50_hz_are_bounded() -> None:
    series = Series()
    for tick in range(2 * 600 * 50):
        series.add(tick / 50, float(tick % 11))
    assert len(series.points()) <= 1200 + 2400 + 2
    assert series.points(since_s=1190.0)[0][0] >= 1190.0


def test_gap_is_marked_once_and_survives_thinning() -> None:
    series = Series(full=4)
    series.gap()
    assert series.points() == []
    for time_s in (0.0, 0.1):
        series.add(time_s, 1.0)
    series.gap()
    series.gap()
    for tick in range(10):
        series.add(5.0 + tick, 2.0)
    assert sum(isnan(value) for _, value in series.points()) == 1


def test_all_series_exist_by_name() -> None:
    history = SeriesTable()
    assert tuple(history) == SERIES
    history["speed"].add(1.0, 0.3)
    assert history["speed"].last == (1.0, 0.3)
    assert history["late_us"].last is None
