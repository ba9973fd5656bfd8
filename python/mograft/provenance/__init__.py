"""Records of grafts: written beside a motion, replayed and edited."""
