"""Report of a study: one HTML page, Markdown, and the README's table."""

from study.report.build import ReportRequest
from study.report.output.files import write
from study.report.output.readme import summary_table

__all__ = ["ReportRequest", "summary_table", "write"]
