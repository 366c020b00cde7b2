"""The groups of ArduRover's parameters, from ArduPilot/ParameterRepository, Rover 4.7."""

import re
from typing import Final

_TEXT: Final = """
    ACRO AEROM AFS AHRS AIS ALAND ARM ARMING ARSPD ATC AUTO AUX AVOID BAL BARO BATT BATTA
    BATTB BATTC BATTD BATTE BATTF BATTG BCN BRD BTAG BTN CAM CAN CFACT CGA CH CIRC COMPASS
    CRASH CRUISE CUST DDS DID DIST DJIR DOCK DR EAHRS EFI EK ENABLE ESC ESRC FENCE FFT FILT
    FLOW FLTMODE FOLL FOLLP FOLT FORMAT FRAME FRSKY FS GCS GEN GPS GRIP GUID INITIAL INS KDE
    LOG LOIT LTE MANUAL MAV MIS MNT MODE MOT MSP NET NMEA NTF OA OSD PARAM PILOT PIVOT PLND
    POI PORT PREV PRX PSC QUIK RALLY RC RCK RCMAP RELAY RK RNGFND RNGFNDA RPM RSSI RST RTL
    RTUN SAIL SCHED SCR SERIAL SERVO SHIP SIM SIMPLE SLUP SPEED SPRAY SRTL STAT STICK TA
    TEMP TERR THR TOFSENSE TRIK TRQ TRQL TURN UM VID VISO VTX WEB WENC WINCH WNDVN WP WRC
"""
GROUPS: Final = frozenset(_TEXT.split())
COMPATIBILITY: Final = re.compile(r"(RCMAP|RC[0-9]+|COMPASS|INS|BATT|SYSID|MAV|FENCE)_")
"""Groups from which a vehicle may have parameters with ArduRover's meaning."""


def has_rover_name(name: str) -> bool:
    """Return True for a name in one of ArduRover's groups."""
    return re.sub(r"[0-9]+$", "", name.split("_")[0]) in GROUPS


def is_compatibility(name: str) -> bool:
    """Return True for a name that clients expect of every Rover."""
    return COMPATIBILITY.match(name) is not None
