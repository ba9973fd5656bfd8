"""Pages and films that show motions: the interactive viewer and the report around it."""

from mograft.viewing.page import Page, view
from mograft.viewing.report import report_page
from mograft.viewing.video import write_video

__all__ = ["Page", "report_page", "view", "write_video"]
