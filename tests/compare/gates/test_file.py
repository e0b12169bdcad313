"""Gate files: what they mean, and everything that is wrong with one at once."""

from __future__ import annotations

from pathlib import Path

import pytest

from attlog.base.errors import UsageError
from attlog.compare.gates.file import read
from attlog.compare.gates.gates import Gate, Gates
from attlog.compare.gates.limits import GateLimit


def gates(folder: Path, text: str) -> Gates:
    file = folder / "gates.toml"
    file.write_text(text, encoding="utf-8")
    return read(file)


def told(folder: Path, text: str) -> list[str]:
    with pytest.raises(UsageError) as caught:
        gates(folder, text)
    return [line.replace(str(folder / "gates.toml"), "F") for line in str(caught.value).splitlines()]


def test_a_file_of_every_kind_of_gate(tmp_path: Path) -> None:
    found = gates(
        tmp_path,
        """
        [gates]
        strict = false
        baseline = "runs/main.jsonl"
        inclination_p95_deg = { max = 2.0, filters = ["mekf", "soft-*"], window = "airborne" }
        lag_ms = [{ max = 5 }, { min = 1, max = 10, filters = "onboard", optional = true }]
        heading_rmse_deg = { max_ratio_to_onboard = 1.2, max_above_baseline = 0.5 }
        noise_tilt_deg = { baseline = "other.json" }
        total_rmse_deg = { baseline = true, window = "20:30.5" }
        """,
    )
    ours = tmp_path / "runs/main.jsonl"
    assert found == Gates(
        (
            Gate("inclination_p95_deg", (GateLimit("max", 2.0),), "airborne", ("mekf", "soft-*"), False, ours),
            Gate("lag_ms", (GateLimit("max", 5.0),), baseline=ours),
            Gate("lag_ms", (GateLimit("min", 1.0), GateLimit("max", 10.0)), None, ("onboard",), True, ours),
            Gate(
                "heading_rmse_deg",
                (GateLimit("max_ratio_to_onboard", 1.2), GateLimit("max_above_baseline", 0.5)),
                baseline=ours,
            ),
            Gate("noise_tilt_deg", (GateLimit("baseline", 0.0),), baseline=tmp_path / "other.json"),
            Gate("total_rmse_deg", (GateLimit("baseline", 0.0),), "20:30.5", baseline=ours),
        ),
        strict=False,
    )


@pytest.mark.parametrize(
    "text", ['"step_error_deg.0.5s" = { max = 3 }', "step_error_deg.0.5s = { max = 3 }", "step_error_deg.0.5s.max = 3"]
)
def test_dots_of_a_metric_need_no_quotes(tmp_path: Path, text: str) -> None:
    (gate,) = gates(tmp_path, f"[gates]\n{text}").gates
    assert gate == Gate("step_error_deg.0.5s", (GateLimit("max", 3.0),))
    assert gates(tmp_path, "[gates.drift_air_deg_per_min.truth]\nmax = 2").gates[0].metric.endswith(".truth")
    assert len(gates(tmp_path, "[[gates.lag_ms]]\nmax = 2\n[[gates.lag_ms]]\nmax = 3").gates) == 2


def test_strict_is_the_default(tmp_path: Path) -> None:
    assert gates(tmp_path, "[gates]\nlag_ms = { max = 5 }").strict


def test_everything_that_is_wrong_is_told_at_once_with_its_line(tmp_path: Path) -> None:
    found = told(
        tmp_path,
        """gate = 1
[gates]
strict = "yes"
baseline = 3
inclination_p95 = { max = 2.0 }
lag_ms = [{ max = 5, windw = "rest" }, { max = true, min = -1, window = "airborn" }]
heading_rmse_deg = 5
coverage_pct = { max_ratio_to_onboard = 1 }
total_rmse_deg = {}
noise_tilt_deg = { baseline = true }
step_gain = { min = 2, max = 1, filters = [], optional = "yes" }
wander_deg = { max = nan, max_ratio_to_onboard = 0 }
hover_jitter_deg = []
""",
    )
    for start, word in (
        ("F, line 1: ", "unknown key gate; did you mean gates?"),
        ("F, line 3: ", "strict: must be a valid boolean (got 'yes')"),
        ("F, line 4: ", "baseline: must be a valid string (got 3)"),
        ("F, line 5: ", "did you mean inclination_p95_deg?"),
        ("F, line 6: lag_ms", "did you mean window?"),
        ("F, line 6: lag_ms", "there is no window airborn; did you mean airborne?"),
        ("F, line 6: lag_ms", "min: must be greater than or equal to 0 (got -1)"),
        ("F, line 6: lag_ms", "max: must be a number (got True)"),
        ("F, line 7: heading_rmse_deg", "write heading_rmse_deg = { max = 2.0 }"),
        ("F, line 8: coverage_pct", "more is better"),
        ("F, line 9: total_rmse_deg", "has no limit"),
        ("F, line 10: noise_tilt_deg", "needs a baseline"),
        ("F, line 11: step_gain", "filters: must be a list of names or patterns (got [])"),
        ("F, line 11: step_gain", "optional: must be a valid boolean (got 'yes')"),
        ("F, line 11: step_gain", "min=2 is above max=1"),
        ("F, line 12: wander_deg", "max: must be a finite number"),
        ("F, line 12: wander_deg", "max_ratio_to_onboard: must be greater than 0"),
        ("F, line 13: hover_jitter_deg", "is []"),
    ):
        assert any(line.startswith(start) and word in line for line in found), (start, word, found)
    assert len(found) == 18


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("", r"holds no \[gates\]"),
        ("[gates]", "holds no gate"),
        ("[gates]\nstrict = true", "holds no gate"),
        ("[gate]\nlag_ms = 1", r"did you mean gates\?"),
        ("[gates\n", "not valid TOML"),
        ("gates = 3", r"holds no \[gates\]"),
    ],
)
def test_a_file_without_gates_is_refused(tmp_path: Path, text: str, word: str) -> None:
    with pytest.raises(UsageError, match=word):
        gates(tmp_path, text)


def test_a_file_that_cannot_be_read_or_is_no_text_is_refused(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match=r"none\.toml: cannot be read"):
        read(tmp_path / "none.toml")
    (tmp_path / "x").write_bytes(b"[gates]\n\xff")
    with pytest.raises(UsageError, match="byte 8"):
        read(tmp_path / "x")
