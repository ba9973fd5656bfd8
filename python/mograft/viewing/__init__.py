"""Pages and films that show motions: the interactive viewer and the report around it."""
