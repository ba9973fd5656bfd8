"""Shared helpers: arrays, argument checks, atomic file writes, reproducible linear algebra."""
