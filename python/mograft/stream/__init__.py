"""Grafts of a base motion that arrives frame by frame, and the server for other programs."""
