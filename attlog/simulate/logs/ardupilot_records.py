"""The records of ArduPilot that a simulated log holds: columns, letters, units and multipliers as Copter 4.6 has them.

From the FMT and FMTU records of ArduPilot's own simulator; ESC: libraries/AP_ESC_Telem/LogStructure.h. IMT, the
record for increments, is that of Copter 4.0 to 4.3.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from attlog.formats import MessageLayout
from attlog.formats.recording import Columns

RECORDS = {
    "IMU": ("I GyrX GyrY GyrZ AccX AccY AccZ EG EA T GH AH GHz AHz", "BffffffIIfBBHH", "#EEEooo--O--zz",
            "-000000-----00"),
    "IMT": ("I DelT DelvT DelaT DelAX DelAY DelAZ DelVX DelVY DelVZ", "Bfffffffff", "#sssrrrnnn", "-000000000"),
    "GYR": ("I SampleUS GyrX GyrY GyrZ", "BQfff", "#sEEE", "-F000"),
    "ACC": ("I SampleUS AccX AccY AccZ", "BQfff", "#sooo", "-F000"),
    "VIBE": ("IMU VibeX VibeY VibeZ Clip", "BfffI", "#ooo-", "-000-"),
    "MAG": ("I MagX MagY MagZ OfsX OfsY OfsZ MOX MOY MOZ Health S", "BhhhhhhhhhBI", "#GGGGGGGGG-s", "-CCCCCCCCC-F"),
    "BARO": ("I Alt AltAMSL Press Temp CRt SMS Offset GndTemp Health", "BfffcfIffB", "#mmPOnsmO-", "-000B0C?0-"),
    "GPS": ("I Status GMS GWk NSats HDop Lat Lng Alt Spd GCrs VZ Yaw U", "BBIHBcLLeffffB", "#-s-S-DUmnhnh-",
            "--C-0BGGB000--"),
    "GPA": ("I VDop HAcc VAcc SAcc YAcc VV SMS Delta Und RTCMFU RTCMFD", "BCCCCfBIHfHH", "#-mmnd-ssm--",
            "-BBBB0-CC0--"),
    "BAT": ("Inst Volt VoltR Curr CurrTot EnrgTot Temp Res RemPct H SH", "BfffffcfBBB", "#vvAaXOw%-%", "-000C0?0000"),
    "ESC": ("Instance RPM RawRPM Volt Curr Temp CTot MotTemp Err", "Bffffcfcf", "#qqvAOaO%", "-00--BCB-"),
    "ATT": ("DesRoll Roll DesPitch Pitch DesYaw Yaw AEKF", "ffffffB", "ddddhh-", "000000-"),
    "RATE": ("RDes R ROut PDes P POut YDes Y YOut ADes A AOut AOutSlew", "fffffffffffff", "kk-kk-kk-oo--",
             "?????????BB--"),
    "CTUN": ("ThI ABst ThO ThH DAlt Alt BAlt DSAlt SAlt TAlt DCRt CRt", "ffffffefffhh", "----mmmmmmnn", "----00B000BB"),
    "RCOU": ("C1 C2 C3 C4", "HHHH", "YYYY", "----"),
    "XKF1": ("C Roll Pitch Yaw VN VE VD dPD PN PE PD GX GY GZ OH", "BccCfffffffccce", "#ddhnnnnmmmkkkm",
             "-BBB0000000BBBB"),
    "XKQ": ("C Q1 Q2 Q3 Q4", "Bffff", "#????", "-????"),
    "XKF4": ("C SV SP SH SM SVT errRP OFN OFE FS TS SS GPS PI", "BcccccfffHBIHb", "#------mm-----", "-------??-----"),
    "SIM": ("Roll Pitch Yaw Alt Lat Lng Q1 Q2 Q3 Q4", "ccCfLLffff", "ddhmDU----", "BBB0GG0000"),
    "SIM2": ("PN PE PD VN VE VD As ASpdU UFC", "dddfffffI", "?????????", "?????????"),
    "MODE": ("Mode ModeNum Rsn", "MBB", "---", "---"),
    "EV": ("Id", "B", "-", "-"),
    "ARM": ("ArmState ArmChecks Forced Method", "BIBB", "----", "----"),
    "VER": ("BT BST Maj Min Pat FWT GH FWS APJ BU FV", "BHBBBBIZHBB", "-----------", "-----------"),
}
"""Columns behind TimeUS, their letters, units and multipliers."""

LAYOUTS = {
    name: MessageLayout("Q" + letters, "s" + units, "F" + mults) for name, (_, letters, units, mults) in RECORDS.items()
}


def record(name: str, t_us: NDArray[np.uint64], **values: Any) -> Columns:
    """The columns of a record; ``values`` are arrays or one value for all, 0 where none is given.

    Columns of the letters c C e E L are the printed numbers. KeyError for unknown columns.
    """
    columns: dict[str, NDArray[Any]] = {"TimeUS": t_us}
    for column in RECORDS[name][0].split():
        given = np.asarray(values.pop(column, b"" if (name, column) == ("VER", "FWS") else 0))
        columns[column] = np.ascontiguousarray(np.broadcast_to(given, t_us.shape))
    if values:
        raise KeyError(f"{name} has no column {', '.join(values)}")
    return columns
