"""Driving by hand: MANUAL_CONTROL and RC_CHANNELS_OVERRIDE of the client in control, in MANUAL.

The axes are those of ArduPilot's Rover: y or channel 1 steers (right is positive), z or channel 3
drives. The speeds are fractions of the robot's largest speeds. They are valid for half a second
after the newest message, those of RC_CHANNELS_OVERRIDE for a second.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

from gateways.mavlink.mav_service import MavService, Sender
from gateways.mavlink.mav_vehicle import ANY, MavVehicle, MessageSource
from gateways.mavlink.mavlink_dialect import MavMessage, mavlink
from gateways.mavlink.motion.setpoints import LIFE_NS, REPEAT_NS, SPEED, TURN, within
from protocol.wire.enums import Mode
from runtime.units import NS_PER_MS, NS_PER_S

FULL: Final = 1000
NO_AXIS: Final = 0x7FFF
"""The value of an axis that the client does not use."""
STICK_NS: Final = 500 * NS_PER_MS
OVERRIDE_NS: Final = NS_PER_S
CHANNELS: Final = 18
STEERING, THROTTLE = 0, 2
NEUTRAL_US, HALF_US = 1500, 500
SHORTEST_US, LONGEST_US = 800, 2200
RELEASED: Final = 0
UNCHANGED: Final = 0xFFFF
RELEASED_UPPER: Final = 0xFFFE
"""This value releases channels from 9 on; 0 does not change them."""
LOWER: Final = 8
NO_VALUE: Final = 0xFFFF
ECHO_HZ: Final = 2.0
NOT_OWNER: Final = "manual control ignored: take control first, by mode MANUAL"


class Stick(NamedTuple):
    """Fractions of the largest speed and turn rate, from -1 to 1, and the time of their end."""

    drive: float
    steer: float
    sender: Sender
    until_ns: int


class ManualDriving(MavService):
    """Sends the speeds to the robot while they are valid."""

    handles = (
        mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL,
        mavlink.MAVLINK_MSG_ID_RC_CHANNELS_OVERRIDE,
    )

    def __init__(self, vehicle: MavVehicle) -> None:
        self._vehicle = vehicle
        self._stick: Stick | None = None
        self._channels = [NO_VALUE] * CHANNELS
        self._overrider: Sender | None = None
        self._overridden_ns = self._sent_ns = 0
        vehicle.catalogue.add(
            MessageSource(
                mavlink.MAVLINK_MSG_ID_RC_CHANNELS,
                self._echo,
                ECHO_HZ,
                ECHO_HZ / 2,
                mavlink.MAV_DATA_STREAM_RC_CHANNELS,
            )
        )

    def receive(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        """Receive the axes or channels of the client in control."""
        is_stick = message.get_msgId() == mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL
        if is_stick and message.target not in (ANY, self._vehicle.system):
            return
        if not (sender.may_command and self._vehicle.control.holds(sender)):
            if self._is_manual:
                self._vehicle.refusals.say(NOT_OWNER, sender.client, now_ns)
        elif is_stick:
            drive, steer = share_of(message.z), share_of(message.y)
            self._drive(Stick(drive, steer, sender, now_ns + STICK_NS), now_ns)
        else:
            self._override(message, sender, now_ns)

    def due(self, now_ns: int) -> None:
        """Repeat the speeds while they are valid."""
        if self._overrider is not None and now_ns - self._overridden_ns >= OVERRIDE_NS:
            self._release()
        stick = self._stick
        if stick is None:
            return
        if (
            not (self._is_manual and self._vehicle.control.holds(stick.sender))
            or now_ns >= stick.until_ns
        ):
            self._stick = None
        elif now_ns - self._sent_ns >= REPEAT_NS and now_ns <= stick.until_ns - LIFE_NS:
            self._drive(stick, now_ns)

    def forget(self, client: int) -> None:
        """Do nothing: the speeds of a client that has disconnected time out."""

    @property
    def _is_manual(self) -> bool:
        return self._vehicle.modes.number == Mode.MANUAL

    def _override(self, message: MavMessage, sender: Sender, now_ns: int) -> None:
        if self._overrider != sender:
            self._release()
        for index in range(CHANNELS):
            value = getattr(message, f"chan{index + 1}_raw")
            self._channels[index] = overridden(index, value, self._channels[index])
        is_released = all(value == NO_VALUE for value in self._channels)
        self._overrider = None if is_released else sender
        self._overridden_ns = now_ns
        drive, steer = (deflection(self._channels[at]) for at in (THROTTLE, STEERING))
        if drive is None and steer is None:
            self._stop()
            return
        until_ns = now_ns + OVERRIDE_NS
        self._drive(Stick(drive or 0.0, steer or 0.0, sender, until_ns), now_ns)

    def _release(self) -> None:
        self._channels = [NO_VALUE] * CHANNELS
        self._overrider = None

    def _drive(self, stick: Stick, now_ns: int) -> None:
        fastest_m_s = self._vehicle.parameters.get(SPEED)
        fastest_rad_s = self._vehicle.parameters.get(TURN)
        if not self._is_manual or fastest_m_s is None or fastest_rad_s is None:
            return
        self._stick, self._sent_ns = stick, now_ns
        self._vehicle.port.drive(stick.drive * fastest_m_s, -stick.steer * fastest_rad_s)

    def _stop(self) -> None:
        if self._stick is not None and self._is_manual:
            self._vehicle.port.drive(0.0, 0.0)
        self._stick = None

    def _echo(self, now_ns: int) -> Sequence[MavMessage]:
        """Return RC_CHANNELS with the overrides in force; none while there is none."""
        if self._overrider is None:
            return ()
        boot_ms = self._vehicle.boot_ms(now_ns)
        strength = 0xFF
        return (mavlink.MAVLink_rc_channels_message(boot_ms, CHANNELS, *self._channels, strength),)


def share_of(axis: int) -> float:
    """Return the deflection of an axis; an unused axis is neutral."""
    return 0.0 if axis == NO_AXIS else within(axis / FULL, 1.0)


def deflection(value_us: int) -> float | None:
    """Return the deflection of a channel; None if it is not overridden."""
    if value_us == NO_VALUE:
        return None
    return within((value_us - NEUTRAL_US) / HALF_US, 1.0)


def overridden(index: int, value: int, before: int) -> int:
    """Return the value of a channel after an override; a value out of range changes nothing."""
    released = RELEASED if index < LOWER else RELEASED_UPPER
    if value == released:
        return NO_VALUE
    return value if SHORTEST_US <= value <= LONGEST_US else before
