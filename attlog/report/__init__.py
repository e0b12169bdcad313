"""A result as one self-contained HTML page. Nothing is computed here that is not drawing."""

from attlog.report.bundle import bundle_notice
from attlog.report.page import write_report

__all__ = ["bundle_notice", "write_report"]
