"""A dataflash log as ArduPilot writes it, the known flight in it, and its telemetry log."""

from __future__ import annotations

import math
import struct
from functools import cache

from flightlog import FlightLog
from sources.logs.onboard_flight import TRAVEL, Flight, flight, telemetry_of, us

from yawid.sources.logs.dataflash import DataflashReader

MAGIC = b"\xa3\x95"
CODES = {
    **{"b": "b", "B": "B", "h": "h", "H": "H", "i": "i", "I": "I", "f": "f", "d": "d"},
    **{"n": "4s", "N": "16s", "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i"},
    **{"M": "B", "q": "q", "Q": "Q"},
}
CENTI = "cCeE"
"""Format characters whose numbers are hundredths."""
CHANNELS = ",".join(f"C{i}" for i in range(1, 15))
LAYOUTS = {
    # name: type, format, columns, units, multipliers, as ArduPlane's
    "FMT": (128, "BBnNZ", "Type,Length,Name,Format,Columns", "-b---", "-----"),
    "UNIT": (130, "QbZ", "TimeUS,Id,Label", "s--", "F--"),
    "FMTU": (131, "QBNN", "TimeUS,FmtType,UnitIds,MultIds", "s---", "F---"),
    "MULT": (132, "Qbd", "TimeUS,Id,Mult", "s--", "F--"),
    "PARM": (64, "QNff", "TimeUS,Name,Value,Default", "s---", "F---"),
    "MSG": (65, "QZ", "TimeUS,Message", "s-", "F-"),
    "MODE": (66, "QMBB", "TimeUS,Mode,ModeNum,Rsn", "s---", "F---"),
    "ARM": (67, "QBIBB", "TimeUS,ArmState,ArmChecks,Forced,Method", "s----", "F----"),
    "ATT": (
        68,
        "QccccCCCCB",
        "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw,AEKF",
        "sddddhhdh-",
        "FBBBBBBBB-",
    ),
    "IMU": (
        69,
        "QBffffffIIfBBHH",
        "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz",
        "s#EEEooo--O--zz",
        "F-000000-----00",
    ),
    "RATE": (
        70,
        "Qffffffffffff",
        "TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,ADes,A,AOut",
        "skk-kk-kk-oo-",
        "F?????????BB-",
    ),
    "RCOU": (71, "Q" + 14 * "H", f"TimeUS,{CHANNELS}", "s" + 14 * "Y", "F" + 14 * "-"),
    "GPS": (
        72,
        "QBBIHBcLLeffffB",
        "TimeUS,I,Status,GMS,GWk,NSats,HDop,Lat,Lng,Alt,Spd,GCrs,VZ,Yaw,U",
        "s#---SmDUmnhnh-",
        "F----0BGGB000--",
    ),
    "CTUN": (
        73,
        "QccccffffBfi",
        "TimeUS,NavRoll,Roll,NavPitch,Pitch,ThO,RdO,ThD,As,AsT,E2T,GU",
        "sdddd---n--n",
        "FBBBB---00-B",
    ),
    "VER": (
        74,
        "QBHBBBBIZHB",
        "TimeUS,BT,BST,Maj,Min,Pat,FWT,GH,FWS,APJ,BU",
        "s----------",
        "F----------",
    ),
    "DSF": (75, "QIHIIII", "TimeUS,Dp,Blk,Bytes,FMn,FMx,FAv", "s--b---", "F--0---"),
    "EV": (76, "QB", "TimeUS,Id", "s-", "F-"),
    "POS": (
        78,
        "QLLfff",
        "TimeUS,Lat,Lng,Alt,RelHomeAlt,RelOriginAlt",
        "sDUmmm",
        "FGG000",
    ),
    "STAT": (
        79,
        "QBfBBBBBB",
        "TimeUS,isFlying,isFlyProb,Armed,Safety,Crash,Still,Stage,Hit",
        "s--------",
        "F--------",
    ),
    "RCIN": (77, "Q" + 14 * "H", f"TimeUS,{CHANNELS}", "s" + 14 * "Y", "F" + 14 * "-"),
}
UNITS = {"s": "s", "d": "deg", "h": "degheading", "k": "deg/s", "E": "rad/s", "n": "m/s"}
MULTIPLIERS = {"-": 0.0, "?": 1.0, "0": 1.0, "B": 1e-2, "F": 1e-6, "G": 1e-7}


class DataflashLog:
    """``data`` is the log; ``starts`` says where each message begins."""

    def __init__(self, *, units: bool = True) -> None:
        self._data = bytearray()
        self.starts: list[tuple[int, str]] = []
        for name, (kind, code, columns, _, _) in LAYOUTS.items():
            size = 3 + struct.calcsize("<" + "".join(CODES[c] for c in code))
            self.add("FMT", kind, size, name, code, columns)
        if units:
            for letter, label in UNITS.items():
                self.add("UNIT", 0, ord(letter), label)
            for letter, factor in MULTIPLIERS.items():
                self.add("MULT", 0, ord(letter), factor)
            for kind, _, _, unit_ids, multiplier_ids in LAYOUTS.values():
                self.add("FMTU", 0, kind, unit_ids, multiplier_ids)

    @property
    def data(self) -> bytes:
        return bytes(self._data)

    def add(self, name: str, *values: float | str) -> None:
        """Append a message by its values in SI or the log's own unit, short ones filled by 0."""
        kind, code, *_ = LAYOUTS[name]
        raw = [
            _raw(character, value)
            for character, value in zip(code, (*values, *([0] * len(code))), strict=False)
        ]
        self.starts.append((len(self._data), name))
        packed = struct.pack("<" + "".join(CODES[c] for c in code), *raw)
        self._data += MAGIC + bytes([kind]) + packed


def _raw(character: str, value: float | str) -> float | bytes:
    if character in "nNZ":
        return str(value).encode() if value else b""
    if character in CENTI:
        return round(100 * float(value))
    if character in "fd":
        return float(value)
    return int(value)


READER = DataflashReader
GPS_WEEK, GPS_MS = 2200, 345_600_000
UNIX_S = 315_964_800 + GPS_WEEK * 604_800 + GPS_MS / 1000 - 18
"""Unix time of the first fix, at the first instant of the flight."""
PARAMETERS = {
    "SYSID_THISMAV": 7,
    "SERVO4_FUNCTION": 21,
    "SERVO4_MIN": TRAVEL[0],
    "SERVO4_TRIM": TRAVEL[1],
    "SERVO4_MAX": TRAVEL[2],
}


def logged(
    flight: Flight, *, rates: str = "IMU", units: bool = True, airspeed_m_s: float = 18.5
) -> DataflashLog:
    """Log a flight as ArduPlane does, parameters within the first seconds."""
    log = DataflashLog(units=units)
    first = us(flight.t[0])
    log.add("MSG", first - 50, "ArduPlane V4.5.7 (abcdef01)")
    log.add("MODE", first - 40, 5, 5, 0)
    log.add("ARM", first - 30, 1, 0, 0, 0)
    pending = list(PARAMETERS.items())
    for k, t in enumerate(flight.t):
        now = us(t)
        if k % 5 == 0:
            yaw = math.degrees(flight.yaw[k]) % 360.0
            roll, pitch = math.degrees(flight.roll[k]), math.degrees(flight.pitch[k])
            log.add("ATT", now, 0, roll, 0, pitch, 0, yaw, 0, 0, 3)
        p, q, r = (float(rate) for rate in flight.rates[k])
        if rates == "RATE":
            p, q, r = (math.degrees(rate) for rate in (p, q, r))
            log.add("RATE", now, 0, p, 0, 0, q, 0, 0, r, 0)
        elif rates == "IMU":
            log.add("IMU", now, 0, p, q, r)
            log.add("IMU", now, 1, 9.0, 9.0, 9.0)
        log.add("RCOU", now + 4000, 1500, 1500, 1500, flight.pwm[k])
        if k % 10 == 0:
            log.add("CTUN", now + 5000, 0, 0, 0, 0, 30, 0, 30, airspeed_m_s)
            log.add("GPS", now + 6000, 0, 3, GPS_MS + 20 * k, GPS_WEEK, 12, 0.8, 0, 0, 500, 17.25)
        if pending and k % 7 == 3:
            log.add("PARM", now + 7000, *pending.pop(0), 0)
    return log


def telemetry(flight: Flight) -> FlightLog:
    """Log the same flight as a ground station does."""
    return telemetry_of(flight, (3, 5), PARAMETERS, 4, 17.25)


@cache
def with_imu() -> DataflashLog:
    return logged(flight())


def whole() -> bytes:
    return with_imu().data


def change(log: DataflashLog, t_us: int) -> None:
    """Append a parameter that changes in flight."""
    log.add("PARM", t_us, "SERVO4_TRIM", 2000, 0)
    log.add("RCOU", t_us + 10_000, 1500)
