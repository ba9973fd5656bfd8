"""Pages that show motions: the interactive viewer and the report around it."""

from mograft.viewing.page import Page, view

__all__ = ["Page", "view"]
