"""A dataflash log as ArduPilot writes it: FMT, UNIT, MULT and FMTU first, then what was flown."""

from __future__ import annotations

import struct

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
