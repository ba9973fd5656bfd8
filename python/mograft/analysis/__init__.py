"""Segmentation, embedding, clustering and channel groups."""
