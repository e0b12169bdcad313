"""Signals of ArduPilot's logs in the figures of flight data, from 3.1 to 4.7.

Columns were renamed several times; the first logged row of a label counts. Factors apply to logs without units (before
3.6).
"""

from __future__ import annotations

from attlog.flight.panels import PanelRows, Row

# Names of a channel's column by era.
CHANNELS = ("C", "Ch", "Chan")

ROWS: PanelRows = {
    "height": (
        Row("onboard", "CTUN.Alt"),
        Row("onboard", "XKF1.PD", -1.0),
        Row("onboard", "NKF1.PD", -1.0),
        Row("onboard", "EKF1.PD", -1.0),
        Row("set-point", "CTUN.DAlt"),
        Row("set-point", "PSCD.TPD", -1.0),
        Row("set-point", "TECS.hdem"),
        Row("set-point", "TECS.h_dem"),
    ),
    "climb": (
        Row("onboard", "XKF1.VD", -1.0),
        Row("onboard", "NKF1.VD", -1.0),
        Row("onboard", "EKF1.VD", -1.0),
        Row("onboard", "CTUN.CRt", 0.01),
        Row("onboard", "TECS.dh"),
        Row("set-point", "CTUN.DCRt", 0.01),
        Row("set-point", "PSCD.TVD", -1.0),
        Row("set-point", "TECS.dhdem"),
        Row("set-point", "TECS.dh_dem"),
    ),
    "speed": (
        Row("onboard", ("XKF1.VN", "XKF1.VE")),
        Row("onboard", ("NKF1.VN", "NKF1.VE")),
        Row("onboard", ("EKF1.VN", "EKF1.VE")),
        Row("set-point", ("PSCN.TVN", "PSCE.TVE")),
        Row("set-point", ("PSC.TVX", "PSC.TVY"), 0.01),
        Row("set-point", ("NTUN.DVelX", "NTUN.DVelY"), 0.01),
        Row("set-point", "THR.DesSpeed"),
        Row("air set-point", "TECS.spdem"),
        Row("air set-point", "TECS.sp_dem"),
    ),
    "outputs": (
        *(Row("output {}", f"RCOU.{name}{{}}") for name in CHANNELS),
        Row("output {}", "RCO2.C{}"),
        Row("motor {}", "MOT.Mot{}"),
    ),
    "esc_current": (Row("ESC", "ESC.Curr"),),
    "stick_pulses": tuple(
        Row(stick, f"RCIN.{name}#") for name in CHANNELS for stick in ("roll", "pitch", "throttle", "yaw")
    ),
    "channels": tuple(Row(f"channel {k}", f"RCIN.{name}{k}") for name in CHANNELS for k in range(5, 13)),
    "volts": (Row("battery", "BAT.Volt"), Row("battery 2", "BAT2.Volt")),
    "amperes": (Row("battery", "BAT.Curr"), Row("battery 2", "BAT2.Curr")),
    "used": (Row("battery", "BAT.CurrTot"), Row("battery", "CURR.CurrTot")),
    "remaining": (Row("battery", "BAT.RemPct"),),
    "rails": (Row("board", "CURR.Vcc", 1e-3), Row("servo rail", "POWR.VServo")),
    "dilution": (Row("vertical", "GPA.VDop"),),
    "link": (Row("receiver signal", "RSSI.RXRSSI", 100.0), Row("receiver link quality", "RSSI.RXLQ")),
    "load": (Row("CPU", "PM.Load", 0.1),),
    "loop": (Row("longest loop", "PM.MaxT", 1e-3),),
    "slow_loops": (Row("slow loops", "PM.NLon"),),
    "dropouts": (Row("logger", "DSF.Dp"),),
    "temperature": (
        Row("IMU", "IMU.T"),
        Row("IMU", "IMU.Temp"),
        Row("barometer", "BARO.Temp"),
        Row("processor", "MCU.MTemp"),
        Row("heater", "HEAT.Temp"),
        Row("battery", "BAT.Temp"),
        Row("ESC", "ESC.Temp"),
        Row("motor", "ESC.MotTemp"),
    ),
}
