"""The figures of the report as plotly figures in a journal's style: :func:`figures`, :func:`figure`."""

from attlog.report.journal.pictures import figure, figures

__all__ = ["figure", "figures"]
