"""The report: one page that opens offline, to compare, to see where a model fails and what it lacks."""

from fingerfit.report.page.build import write_page
from fingerfit.report.page.ladder import ladder_figure, profile_figure

__all__ = ["ladder_figure", "profile_figure", "write_page"]
