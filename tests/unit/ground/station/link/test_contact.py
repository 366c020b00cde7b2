"""The age of a loss counts from the last message of what is lost, not from an earlier loss."""

from ground.station.link.link_monitor import CHANGED_NS, ONSET_NS, Contact
from ground.station.link.loss import LossKind
from tests.support.each import each

S = 1_000_000_000


def lost(contact: Contact, kind: LossKind, at_ns: int, since_ns: int) -> int:
    """Report a kind of loss until it is taken; return the time."""
    assert contact.update(kind, at_ns, since_ns) is None
    sure_ns = ONSET_NS if contact.is_receiving else CHANGED_NS
    change = contact.update(kind, at_ns + sure_ns, since_ns)
    assert change is not None
    assert change.gap_ns == at_ns + sure_ns - contact.since_ns
    return at_ns + sure_ns


@each("before", [LossKind.OTHER_OPERATOR, LossKind.SENSES_STALE])
def test_loss_of_a_received_robot_has_an_age_of_its_own(before: LossKind) -> None:
    contact = Contact(0)
    lost(contact, before, 1 * S, 1 * S)
    lost(contact, LossKind.PROCESS_DEAD, 5 * S, 5 * S)
    assert contact.since_ns == 5 * S


def test_other_name_of_the_same_silence_keeps_its_age() -> None:
    contact = Contact(0)
    lost(contact, LossKind.TRANSPORT, 1 * S, 1 * S)
    lost(contact, LossKind.PROCESS_DEAD, 3 * S, 2 * S)
    assert contact.since_ns == 1 * S


def test_robot_that_is_received_again_begins_another_loss() -> None:
    contact = Contact(0)
    lost(contact, LossKind.HUNG, 1 * S, 1 * S)
    lost(contact, LossKind.OTHER_OPERATOR, 6 * S, 6 * S)
    assert contact.since_ns == 6 * S
