"""New motions from a library: grafts, repairs and streams."""
