"""Simulated network faults: loss, duplication, delay and order, equal for equal seeds."""

from pathlib import Path

import pytest

from protocol.bus.link_faults import FaultyLink, LinkFaults, earliest
from protocol.bus.network import Network
from runtime import config
from runtime.errors import ConfigError, UserError
from tests.support.each import each

MS = 1_000_000
MANY = 4000


def sent(
    trouble: LinkFaults, samples: int = MANY, key: str = "sidestep/r1/sense/sonar"
) -> list[int]:
    """Send a numbered sample every 50 ms; return all samples that are delivered."""
    way: FaultyLink[int] = FaultyLink(trouble, key)
    found = [one for number in range(samples) for one in way.take(number, number * 50 * MS)]
    return found + way.due(samples * 100 * MS)


def test_without_a_share_or_a_delay_all_pass_in_order() -> None:
    assert sent(LinkFaults()) == list(range(MANY))


def test_loss_share_equals_the_requested_one() -> None:
    assert len(sent(LinkFaults(loss=0.2))) == pytest.approx(0.8 * MANY, rel=0.03)
    assert sent(LinkFaults(loss=1.0)) == []


def test_losses_depend_only_on_seed_and_key() -> None:
    first = sent(LinkFaults(loss=0.2, seed=1))
    assert sent(LinkFaults(loss=0.2, seed=1)) == first
    assert sent(LinkFaults(loss=0.2, seed=2)) != first
    assert sent(LinkFaults(loss=0.2, seed=1), key="sidestep/r1/drive/wheels") != first


def test_duplicate_follows_its_original() -> None:
    found = sent(LinkFaults(duplicate=0.3))
    assert found == sorted(found)
    assert len(found) == pytest.approx(1.3 * MANY, rel=0.03)
    assert set(found) == set(range(MANY))


def test_overtaken_sample_follows_the_next_and_none_is_lost() -> None:
    found = sent(LinkFaults(reorder=0.3), 40)
    assert found != sorted(found)
    assert max(abs(at - number) for at, number in enumerate(found)) == 1
    assert set(found) >= set(range(39)), "the very last may still be held back"


def test_each_sample_is_late_by_delay_plus_at_most_jitter() -> None:
    way: FaultyLink[str] = FaultyLink(LinkFaults(delay_ms=100, jitter_ms=50), "k")
    assert way.take("a", 0) == []
    assert way.due(100 * MS - 1) == []
    assert way.next_ns is not None
    assert 100 * MS <= way.next_ns <= 150 * MS
    assert way.due(150 * MS) == ["a"]
    assert way.next_ns is None


def test_earliest_due_time_covers_all_links() -> None:
    ways: list[FaultyLink[int]] = [FaultyLink(LinkFaults(delay_ms=ms), "k") for ms in (80, 20, 50)]
    assert earliest(ways) is None
    for way in ways:
        way.take(1, 0)
    assert earliest(ways) == 20 * MS


def test_fault_applies_to_named_topics_or_to_all() -> None:
    assert LinkFaults().concerns("tlm/text")
    assert LinkFaults(paths=("sense/", "drive/wheels")).concerns("sense/sonar")
    assert not LinkFaults(paths=("sense/", "drive/wheels")).concerns("tlm/text")


@each("field", ["loss", "duplicate", "reorder", "delay_ms", "jitter_ms"])
@each("value", [-0.1, 1e9])
def test_impossible_link_fault_is_rejected_by_name(field: str, value: float) -> None:
    with pytest.raises(UserError, match=field):
        LinkFaults(**{field: value})  # type: ignore[arg-type]


def test_link_faults_are_a_table_of_the_configuration(tmp_path: Path) -> None:
    file = tmp_path / "bad.toml"
    file.write_text('connect = ["tcp/127.0.0.1:1"]\n[trouble]\nloss = 0.05\npaths = ["sense/"]\n')
    assert config.load(file, Network).trouble == LinkFaults(loss=0.05, paths=("sense/",))
    file.write_text("[trouble]\nlos = 0.05\n")
    with pytest.raises(ConfigError, match="did you mean 'loss'"):
        config.load(file, Network)
