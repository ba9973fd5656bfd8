"""Pages and films that show motions: the interactive viewer and the report around it."""

from mograft.viewing.page import Page, view
from mograft.viewing.report import center_of_mass, report_page
from mograft.viewing.video import write_video

__all__ = ["Page", "center_of_mass", "report_page", "view", "write_video"]
