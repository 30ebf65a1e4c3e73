"""A run drawn and written down: figures for print and one HTML page that answers the exposure question."""

from blurnoise_eval.report.data import RunData
from blurnoise_eval.report.page import figures_of, write_report

__all__ = ["RunData", "figures_of", "write_report"]
