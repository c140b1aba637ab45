"""The report of a run: one self-contained HTML page that prints well."""

from mvp.cell.report.write import write_report

__all__ = ["write_report"]
