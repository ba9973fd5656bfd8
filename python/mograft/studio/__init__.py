"""The studio: an editor of grafts in the browser."""
