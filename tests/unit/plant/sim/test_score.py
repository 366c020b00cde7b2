from hashlib import sha256
from struct import pack

import pytest

from plant.sim import simulation as score_module
from plant.sim.simulation import Score

TICK_NS = 50_000_000
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
