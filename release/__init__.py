"""Build, check and try the distributions of this repository: ``python -m release --dry-run``."""
