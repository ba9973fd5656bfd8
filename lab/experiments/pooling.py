"""Estimates over several sources, and differences of estimates."""

import math

Z = 1.959964  # of a 95 % interval


def standard_error(estimate):
    """Return the standard error that the interval of an estimate stands for, or None."""
    if estimate["value"] is None or estimate["interval"] is None:
        return None
    low, high = estimate["interval"]
    return (high - low) / (2 * Z)


def pool(estimates):
    """Return the mean of the estimates of several sources, whose errors are independent.

    Estimates without a value are left out, and those without an interval if others have one. The
    interval is that of a normal distribution; it
    covers the errors within the sources, and not the choice of the sources. `n` is the sum.
    """
    known = [own for own in estimates if own["value"] is not None]
    found = [own for own in known if own["interval"] is not None] or known
    errors = [standard_error(own) for own in found]
    return _normal(
        sum(own["value"] for own in found) / len(found) if found else None,
        None if None in errors or not found else math.hypot(*errors) / len(found),
        sum(own["n"] for own in found),
        found[0]["of"] if found else "",
        f"mean of {len(found)} sources",
    )


def subtract(first, second):
    """Return the difference of two estimates, as if their errors were independent.

    For estimates from the same clips the interval is too wide rather than too narrow, unless
    their errors are negatively correlated.
    """
    errors = standard_error(first), standard_error(second)
    is_known = first["value"] is not None and second["value"] is not None
    return _normal(
        first["value"] - second["value"] if is_known else None,
        None if None in errors else math.hypot(*errors),
        min(first["n"], second["n"]),
        first["of"],
        "difference of two estimates",
    )


def _normal(value, error, n, unit, method):
    interval = None if value is None or error is None else [value - Z * error, value + Z * error]
    return {"value": value, "interval": interval, "n": n, "of": unit, "method": method}
