"""`kitasap report`: one page of HTML about the runs in some folders."""

from experiments.report.page import Missing, write_report

__all__ = ["Missing", "write_report"]
