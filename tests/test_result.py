"""What is written is what is read: results as files."""

from __future__ import annotations

import dataclasses
import json
import math
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

import attlog
from attlog.base.errors import LogUnreadable, UsageError
from attlog.plain import Misfit, plain, restored
from attlog.result import SCHEMA, Result
from tests.conftest import SAMPLES, few

LOGS = [p for p in sorted(SAMPLES.iterdir()) if p.suffix in (".ulg", ".bin", ".tlog")]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("result") / "log.json"
    attlog.evaluate(attlog.prepare(SAMPLES / "copter_steps_stabilize.bin"), ["mahony", "gyro"]).to_json(path)
    return path


@pytest.mark.parametrize("log", few(LOGS, 1), ids=lambda p: p.name)
@pytest.mark.parametrize("reference", ["auto", "none"])
def test_a_result_reads_back_to_the_same_text(log: Path, reference: str, tmp_path: Path) -> None:
    result = attlog.evaluate(attlog.prepare(log, {"reference": reference}), ["mahony", "madgwick"], cost=True)
    for deterministic in (False, True):
        text = result.to_json(tmp_path / "a.json", deterministic)
        assert Result.load(tmp_path / "a.json").to_json(deterministic=deterministic) == text


def test_what_is_read_are_the_same_dataclasses(written: Path) -> None:
    found = Result.load(written)
    row = next(r for r in found.estimators if r.name == "mahony")
    answer = row.metrics["rest"]["noise_roll_deg"]
    assert isinstance(answer.ci95, tuple)
    assert answer.ci95[0] < (answer.value or 0.0) < answer.ci95[1]
    assert row.parameters["kp"].origin == "default"
    assert found.segments[0].seconds > 0
    assert found.table("rest").loc["mahony", "noise_roll_deg"] == answer.value
    assert found.traces == []


def test_a_report_can_be_written_from_a_file(written: Path, tmp_path: Path) -> None:
    Result.load(written).to_html(tmp_path / "again.html")
    assert "mahony" in (tmp_path / "again.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("schema", "says"),
    [
        ("attlog-result/0", "analyse the log again"),
        ("attlog-result/99", "a newer attlog wrote it"),
        ("attlog-result/x", "analyse the log again"),
        ("other/2", "no schema"),
        (None, "no schema"),
    ],
)
def test_another_schema_is_refused_in_words(written: Path, tmp_path: Path, schema: str | None, says: str) -> None:
    document = json.loads(written.read_text()) | {"schema": schema}
    other = tmp_path / "other.json"
    other.write_text(json.dumps(document))
    with pytest.raises(UsageError, match=says) as refused:
        Result.load(other)
    assert "other.json" in str(refused.value)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "line 1, column 1 .the file ends there"),
        (b'{"schema": "attlog-result/3",\n "log": {"a": [1, 2', "line 2, column .* cut off"),
        (b'{"schema": ]}', "line 1, column 12"),
        (b"[1, 2]", "no schema"),
        (b'"text"', "no schema"),
        (b"\xff\xfe{}", "no UTF-8 text at byte 0"),
        (b'{"schema": NaN}', "NaN is no number of JSON"),
        (b"[" * 200_000, "not a result"),
        (b'{"schema": "attlog-result/3"}', "attlog: is missing"),
    ],
)
def test_what_is_no_result_is_refused_with_the_place(tmp_path: Path, content: bytes, says: str) -> None:
    file = tmp_path / "x.json"
    file.write_bytes(content)
    with pytest.raises(UsageError, match=says):
        Result.load(file)


def test_a_file_cut_anywhere_is_refused(written: Path, tmp_path: Path) -> None:
    text = written.read_text().rstrip()
    file = tmp_path / "cut.json"
    for share in (0.1, 0.5, 0.9, 0.999):
        file.write_text(text[: int(share * len(text))])
        with pytest.raises(UsageError, match="not valid JSON"):
            Result.load(file)


def test_a_file_that_is_not_there_cannot_be_read(tmp_path: Path) -> None:
    for path in (tmp_path / "missing.json", tmp_path):
        with pytest.raises(LogUnreadable, match="cannot be read"):
            Result.load(path)


@pytest.mark.parametrize(
    ("path", "value", "says"),
    [
        (("estimators", 0, "name"), 3, r"estimators\[0\].name: a whole number instead of a text"),
        (("estimators", 0, "causal"), 1, r"estimators\[0\].causal: a whole number instead of true or false"),
        (("estimators", 0, "metrics", "rest", "noise_roll_deg", "value"), "1", "noise_roll_deg.value: a text instead"),
        (("estimators", 0, "metrics", "rest", "noise_roll_deg", "ci95"), [1.0], "ci95: a list instead of a list of 2"),
        (("estimators", 0, "metrics", "rest", "noise_roll_deg", "extra"), 1, "noise_roll_deg.extra: unknown key"),
        (("segments", 0), [], r"segments\[0\]: a list instead of an object"),
        (("verdicts",), {}, "verdicts: an object instead of a list"),
        (("best", "rest"), 1, "best.rest: a whole number instead of an object"),
    ],
)
def test_a_wrong_value_is_told_with_its_place(
    written: Path, tmp_path: Path, path: tuple[str | int, ...], value: object, says: str
) -> None:
    document: Any = json.loads(written.read_text())
    place = document
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    file = tmp_path / "wrong.json"
    file.write_text(json.dumps(document))
    with pytest.raises(UsageError, match=says):
        Result.load(file)


def test_a_missing_key_is_told_with_its_place(written: Path, tmp_path: Path) -> None:
    document = json.loads(written.read_text())
    del document["reference"]["source"]
    file = tmp_path / "wrong.json"
    file.write_text(json.dumps(document))
    with pytest.raises(UsageError, match=r"reference\.source: is missing"):
        Result.load(file)


def test_reading_a_result_imports_nothing_heavy(written: Path) -> None:
    code = (
        f"import sys\nfrom attlog.result import Result\nResult.load({str(written)!r})\n"
        "print(sorted({'pandas', 'numba', 'scipy', 'plotly', 'pymavlink', 'pyulog', 'jinja2'} & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"


@dataclasses.dataclass
class Made:
    """All kinds of fields."""

    number: float
    pairs: dict[str, tuple[int, str]]
    maybe: float | str | None = None


def test_a_null_for_a_number_is_no_number() -> None:
    found = restored(Made, plain(Made(math.inf, {"a": (1, "x")})))
    assert math.isnan(found.number)
    assert found == Made(found.number, {"a": (1, "x")}, None)
    for wrong, place in (
        ({"number": 1, "pairs": {"a": [1, 2]}, "maybe": None}, r"pairs.a\[1\]"),
        ({"number": True, "pairs": {}, "maybe": None}, "number"),
        ({"number": 1, "pairs": {}, "maybe": []}, "maybe: a list instead of a number and a list instead of a text"),
        ([], "the document"),
    ):
        with pytest.raises(Misfit, match=place):
            restored(Made, wrong)


def test_the_schema_names_the_version_that_is_read() -> None:
    from attlog.schema import schema

    assert schema()["properties"]["schema"] == {"const": SCHEMA}
    assert "traces" not in schema()["properties"]


def test_an_array_may_be_named_by_a_type_statement() -> None:
    """As numpy 2.5 names ``NDArray`` on Python 3.12 and later: there nothing could be read back."""
    from typing import TypeVar

    import numpy as np
    from typing_extensions import TypeAliasType

    kind = TypeVar("kind", bound=np.generic)
    named = TypeAliasType("named", np.ndarray[tuple[Any, ...], np.dtype[kind]], type_params=(kind,))
    made: Any = dataclasses.make_dataclass("Made", [("x", named[np.int64]), ("y", named[np.float64] | None)])
    found: Any = restored(made, {"x": [1, 2], "y": [0.5]})
    assert (found.x.dtype, found.x.tolist(), found.y.dtype) == (np.int64, [1, 2], np.float64)
