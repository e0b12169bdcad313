"""Report page of one log."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from markupsafe import Markup

from attlog.core.files import write_atomic
from attlog.core.own_files import REPORT
from attlog.core.plain import json_text, without_keys
from attlog.health.settings import param_file
from attlog.metrics.trace import envelope
from attlog.report import shell
from attlog.report.bundle import ArrayPacker, Bundle, bundle
from attlog.report.figures.behind import figure_behind, view_named
from attlog.report.figures.catalogue import UNTITLED, sections
from attlog.report.figures.figure import FigureSource, PageFigure
from attlog.report.figures.signals import Picker, picker
from attlog.report.first_screen import STRIP_HEIGHT, compare_filters, flight_strip
from attlog.result import MEASURED_TIMES, Result, Trace, agreed_settings
from attlog.result.document import EVIDENCE
from attlog.words.events import ShownEvent, minor_title, shown_events
from attlog.words.findings import (
    ShownCheck,
    ShownFinding,
    findings,
    first_screen_findings,
    question_titles,
    reasons_unknown,
    repeat_advice_once,
    shown_checks,
)
from attlog.words.flight import (
    alarming,
    firmware,
    flight_tone,
    gyro_bias_text,
    level_name,
    messages,
    rerun_summaries,
    subtitle,
    what_happened,
)
from attlog.words.names import duplicate_rows_text
from attlog.words.numbers import counted, duration, moment, number, quantity, unit_sign
from attlog.words.parameters import parameter_counts, parameter_lines
from attlog.words.table import axis_table, main_table, window_tables
from attlog.words.text import clean, plain_value, typeset, with_fixed_units

# Functions available in the template.
FILTERS: dict[str, Callable[..., Any]] = {
    "unit": unit_sign,
    "duration": duration,
    "quantity": quantity,
    "number": number,
    "value": plain_value,
    "typeset": typeset,
    "moment": moment,
    "counted": counted,
    "said_once": repeat_advice_once,
    "minor_title": minor_title,
    "titles": question_titles,
    "reasons": reasons_unknown,
    "first_screen": first_screen_findings,
}

# Bytes of a page without plotly.js, with which it stays below 3 MB: beyond them, samples of signals are reduced, down
# to the least, then the evidence behind answers is left to the JSON file, then lines of figures are reduced.
MAX_OWN_BYTES, LEAST_SAMPLES_BYTES = 2_400_000, 200_000
# Lines over time, which take most of a page's bytes, and samples that each keeps in any case.
LONG_LINES = ("attitude", "difference", "bias", "rest", "rerun", "demand", "sigma", "drift", "data")
LEAST_LINE_SAMPLES = 1000
# Reduction of long lines over the excess, because extremes are compressed less, and reductions tried.
REDUCTION_MARGIN, MAX_REDUCTIONS = 1.5, 8


def write_report(result: Result, path: str | Path, *, deterministic: bool = False, document: str | None = None) -> None:
    """Write the report of a result to ``path`` (atomically). OutputError on failure.

    ``deterministic`` leaves measured times out: the same log gives the same bytes. ``document``: output of
    ``Result.to_json``, if already computed.
    """
    write_atomic(Path(path), render(result, deterministic=deterministic, document=document), REPORT)


def render(
    result: Result, plot: Bundle | None = None, *, deterministic: bool = False, document: str | None = None
) -> str:
    """Return the report as text: template, style and script of this package, packed data."""
    document = result.to_json(deterministic=deterministic) if document is None else document
    result = without_times(result) if deterministic else result
    plot = plot or bundle()
    limit = MAX_OWN_BYTES + len(plot.packed) * 4 // 3
    samples = picker(result)
    page = drawn(result, document, plot, samples, deterministic, evidence=True)
    if len(page) > limit and samples is not None:
        fewer = picker(result, max(len(samples.block) - (len(page) - limit), LEAST_SAMPLES_BYTES))
        page = page.replace(samples.block, fewer.block) if fewer is not None else page
        samples = fewer
    if len(page) > limit:
        whole = json.loads(document)
        document = json_text(whole | {"estimators": without_keys(whole.get("estimators", []), EVIDENCE)})
        page = drawn(result, document, plot, samples, deterministic, evidence=False)
    for _ in range(MAX_REDUCTIONS):
        spare = sum(map(spare_values, result.traces))
        if len(page) <= limit or not spare:
            break
        data = len(re.findall(r'id="data">([^<]*)', page)[0])
        values = sum(len(trace.t) * len(trace.columns) for trace in result.traces)
        excess = REDUCTION_MARGIN * values * (len(page) - limit) / data
        result = with_fewer_samples(result, max(1.0 - excess / spare, 0.0))
        page = drawn(result, document, plot, samples, deterministic, evidence=False)
    return page


def spare_values(trace: Trace) -> int:
    """Return how many values of a long line can be left out, 0 of other lines."""
    return max(len(trace.t) - LEAST_LINE_SAMPLES, 0) * len(trace.columns) if trace.figure in LONG_LINES else 0


def with_fewer_samples(result: Result, share: float) -> Result:
    """Return the result with a share of the spare samples of its long lines, their peaks kept."""

    def fewer(trace: Trace) -> Trace:
        if not spare_values(trace):
            return trace
        keep = LEAST_LINE_SAMPLES + int(share * (len(trace.t) - LEAST_LINE_SAMPLES))
        t, kept = envelope(trace.t, np.column_stack(list(trace.columns.values())), keep)
        columns = {name: kept[:, k] for k, name in enumerate(trace.columns)}
        return replace(trace, t=t, columns=columns, ratio=trace.ratio * len(trace.t) / len(t))

    return replace(result, traces=[fewer(trace) for trace in result.traces])


def drawn(
    result: Result, document: str, plot: Bundle, chosen: Picker | None, deterministic: bool, evidence: bool
) -> str:
    """Return the page of a result; ``evidence``: its JSON holds the evidence behind each answer."""
    source = FigureSource.of(result)
    look, figures, lines = source.styles, sections(source), parameter_lines(result)
    lost = {event.t: event.kind for event in result.events if event.kind in ("overturn", "tumble")}
    behind = places_behind(figures, {"parameters"} if lines else set(), lost)
    return shell.render(
        "page.html",
        rows=source.rows,
        figures=[figure for part in figures.values() for figure in part],
        document=document,
        evidence=evidence,
        filters=FILTERS,
        marks=source.marks,
        more={
            "parameters": [line.for_script for line in lines],
            "picker": chosen and shell.figure_header(chosen.figure, ArrayPacker()),
        },
        picker=chosen,
        log=file_stem(result),
        plot=plot,
        result=result,
        look=look,
        replayed=any(row.kind == "replay" and row.metrics for row in result.estimators),
        title=str(result.log.get("name") or "log"),
        subtitle=subtitle(result),
        headline=with_fixed_units(what_happened(result)),
        tone=flight_tone(result),
        strip=flight_strip(result),
        strip_height=STRIP_HEIGHT,
        happened=shown_events(result),
        reruns=rerun_summaries(result),
        four=compare_filters(result, look),
        checked=sum(check.verdict == "ok" for check in result.checks),
        notes=answer_notes(result),
        findings=findings(result),
        gyro_bias=gyro_bias_text(result),
        alike=duplicate_rows_text(result),
        numbers=main_table(result),
        axes=axis_table(result),
        windows=window_tables(result),
        sections=figures,
        behind=behind,
        parameters=lines,
        parameter_counts=parameter_counts(lines),
        checks=shown_checks(result.checks),
        param_file=param_file(result.log, agreed_settings(result.checks)),
        file_stem=file_stem(result),
        messages=[(t, level_name(level), alarming(level, text), text) for t, level, text in messages(result)],
        config=toml(result.config),
        firmware=firmware(result),
        definitions={m: d for m, d in result.definitions.items() if not (deterministic and m in MEASURED_TIMES)},
    )


def answer_notes(result: Result) -> dict[str, list[str]]:
    """Return how each answer was measured; with accuracy why the onboard filter was not run again."""
    notes = {verdict.question: list(verdict.notes) for verdict in result.verdicts}
    reruns = any(row.reproduction is not None for row in result.estimators)
    if result.not_rerun and not reruns:
        notes.setdefault("accuracy", []).append(typeset(result.not_rerun))
    return notes


Behind = Callable[[Any], "Place | None"]


class Place(NamedTuple):
    """Place on the page that shows a finding, event or check: link and title.

    ``view``: number of the figure's view that the link chooses, None where the figure stays as it is.
    """

    href: str
    title: str
    view: int | None = None

    @property
    def attributes(self) -> Markup:
        """Attributes of its link."""
        chosen = "" if self.view is None else Markup(' data-view="{}"').format(self.view)
        return Markup(' title="{}"').format(clean(self.title)) + chosen


def places_behind(
    figures: Mapping[str, Sequence[PageFigure]], others: Collection[str] = (), lost: Mapping[float, str] | None = None
) -> Behind:
    """Return a function from a shown finding, event or check to the figure behind it, None without one.

    ``others``: ids of places that are no figures. ``lost``: kind of a loss of control by its time, which a finding of
    a crash is shown by.
    """
    rounded = {round(t, 3): kind for t, kind in (lost or {}).items()}
    titles = {figure.id: figure.title for part in figures.values() for figure in part}
    views = {figure.id: figure.views for part in figures.values() for figure in part}

    def behind(shown: ShownFinding | ShownEvent | ShownCheck) -> Place | None:
        kind, about = (shown.id, shown.id) if isinstance(shown, ShownCheck) else (shown.kind, shown.about)
        kind = rounded.get(round(shown.t, 3), kind) if kind == "crash" and shown.t is not None else kind
        name = figure_behind(kind, about, shown.text, shown.t is not None, titles.keys() | set(others))
        if name in titles:
            sensor = shown.sensor if isinstance(shown, ShownCheck) else ""
            return Place(f"#fig-{name}", titles[name] or UNTITLED, view_named(views[name], sensor, shown.text))
        return Place(f"#{name}", name.capitalize()) if name else None

    return behind


def file_stem(result: Result) -> str:
    """Return the log's name without suffix, safe as start of file names."""
    stem = Path(str(result.log.get("name") or "")).stem
    return re.sub(r"[^A-Za-z0-9_.-]+", "_", stem)[:80].strip("._-") or "attlog"


def without_times(result: Result) -> Result:
    """Return the result without fields that differ between runs of the same log."""

    def left(found: dict[str, Any]) -> dict[str, Any]:
        return {name: value for name, value in found.items() if name not in MEASURED_TIMES}

    def by_window(found: dict[str, Any]) -> dict[str, Any]:
        return {window: left(columns) for window, columns in found.items()}

    rows = [replace(row, ns_per_update=None, metrics=by_window(row.metrics)) for row in result.estimators]
    return replace(
        result,
        command="",
        timing={},
        estimators=rows,
        best=by_window(result.best),
        worst=by_window(result.worst),
        ranked=by_window(result.ranked),
    )


def toml(config: dict[str, Any]) -> str:
    """Format the resolved configuration as a file for ``--config``, without unset options."""
    import tomli_w

    return tomli_w.dumps(without_none(config))


def without_none(value: Any) -> Any:
    """Remove None values, which TOML lacks."""
    if isinstance(value, dict):
        return {str(k): without_none(v) for k, v in value.items() if v is not None}
    return [without_none(v) for v in value if v is not None] if isinstance(value, (list, tuple)) else value
