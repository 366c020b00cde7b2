from gateways.mavlink.clients import ClientLink
from gateways.mavlink.gateway import Reporter
from gateways.mavlink.operator_control import Owner
from runtime.units import NS_PER_S
from tests.unit.ground.gateway.clients.test_framing import packed


def fed(link: ClientLink, *sequences: int) -> None:
    link.allow(100)
    for sequence in sequences:
        link.feed(packed(sequence=sequence))
    link.frames(0)


def test_state_of_all_clients_is_reported_once_a_second() -> None:
    reporter, one, other = Reporter(0), ClientLink(1, "a", 0), ClientLink(2, "b", 0)
    fed(one, 0, 1, 2, 5)
    fed(other, 0, 1)
    other.signing.signed, other.signing.forged, other.signing.future = 2, 3, 4
    reporter.sent(1, 3_000)
    reporter.sent(2, 100)
    owners = {1: Owner(2, 255), 2: None}
    first, second = reporter.take([one, other], owners, 2 * NS_PER_S)
    assert (first.system, first.clients, first.signing, first.owner) == (1, 2, 1, 255)
    assert (first.sent_bytes_s, second.sent_bytes_s) == (1_500, 50)
    assert (first.received_hz, first.lost_permille, first.refused) == (3, 250, 7)
    assert (second.system, second.owner) == (2, 0)
    assert not reporter.is_due(3 * NS_PER_S - 1)
    assert reporter.is_due(3 * NS_PER_S)


def test_client_that_has_gone_keeps_its_refused_frames() -> None:
    reporter, link = Reporter(0), ClientLink(1, "a", 0)
    fed(link, 0, 1)
    link.signing.replayed = 5
    reporter.take([link], {1: None}, NS_PER_S)
    reporter.left(link)
    (status,) = reporter.take([], {1: None}, 2 * NS_PER_S)
    assert (status.clients, status.refused, status.received_hz) == (0, 5, 0)


def test_frames_that_were_overtaken_are_no_negative_loss() -> None:
    reporter, link = Reporter(0), ClientLink(1, "a", 0)
    fed(link, 0, 3)
    (before,) = reporter.take([link], {1: None}, NS_PER_S)
    fed(link, 1, 2)
    (after,) = reporter.take([link], {1: None}, 2 * NS_PER_S)
    assert (before.lost_permille, after.lost_permille) == (500, 0)
