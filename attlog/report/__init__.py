"""Write a result as one self-contained HTML page; nothing is computed here."""

from attlog.report.bundle import bundle_notice
from attlog.report.page import write_report

__all__ = ["bundle_notice", "write_report"]
