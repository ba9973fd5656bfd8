"""Pages that show motions: the interactive viewer and the report around it."""

from mograft.viewing.page import Page, view
from mograft.viewing.report import report_page

__all__ = ["Page", "report_page", "view"]
