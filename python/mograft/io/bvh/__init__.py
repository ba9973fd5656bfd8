"""BVH files: reading, scanning and writing."""
