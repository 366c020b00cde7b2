"""What a study comes to, for people: one HTML page, Markdown, and the README's table."""

from study.report.build import Asked
from study.report.files import write
from study.report.readme import summary_table

__all__ = ["Asked", "summary_table", "write"]
