"""HTML pages, reports and films of motions and grafts."""
