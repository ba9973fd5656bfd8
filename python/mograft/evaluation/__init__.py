"""Honest measures: how many motions can be made, how natural, how balanced, how smooth.

Each measure takes a library or grafts of one and returns numbers with their sample size and
interval. Where the data cannot support a number it raises `InsufficientDataError`.
"""
