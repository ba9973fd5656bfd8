"""Pages that show motions: the interactive viewer and the report around it."""

from mograft.viewing.page import Page, view
from mograft.viewing.report import center_of_mass, report_page

__all__ = ["Page", "center_of_mass", "report_page", "view"]
