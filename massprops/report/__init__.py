"""The one-file HTML report: opens offline, asks for nothing from outside."""

from massprops.report.page import write_report

__all__ = ["write_report"]
