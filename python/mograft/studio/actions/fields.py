"""The fields of an action or a question, which a page sends as JSON."""

from collections.abc import Collection, Mapping
from typing import Any

from mograft._util.validate import as_integer, check_choice, is_integer
from mograft.search.constraints import Span, as_span


class Fields:
    """Fields by name; methods return one, or raise ValueError that names it."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        self.values = values

    def has(self, name: str) -> bool:
        """Return whether a field is given, and is not null."""
        return self.values.get(name) is not None

    def text(self, name: str, default: str | None = None) -> str:
        """Return a text."""
        value = self.values.get(name, default)
        if not isinstance(value, str):
            raise ValueError(f"`{name}` must be a text, got {value!r}")
        return value

    def optional_text(self, name: str) -> str | None:
        """Return a text, None for null or nothing."""
        return self.text(name) if self.has(name) else None

    def integer(self, name: str, default: int, minimum: int = 0, maximum: int = 10**9) -> int:
        """Return a whole number."""
        value = as_integer(name, self.values[name] if self.has(name) else default, minimum)
        if value > maximum:
            raise ValueError(f"`{name}` must be at most {maximum}, got {value}")
        return value

    def number(self, name: str) -> float | None:
        """Return a number, None for null or nothing."""
        value = self.values.get(name)
        if value is not None and (isinstance(value, bool) or not isinstance(value, int | float)):
            raise ValueError(f"`{name}` must be a number, got {value!r}")
        return None if value is None else float(value)

    def flag(self, name: str) -> bool:
        """Return a boolean, by default false."""
        value = self.values.get(name, False)
        if not isinstance(value, bool):
            raise ValueError(f"`{name}` must be true or false, got {value!r}")
        return value

    def frames(self) -> Span:
        """Return the fields ``first`` and ``last``."""
        return as_span("first, last", (self.values.get("first"), self.values.get("last")))

    def choice(self, name: str, accepted: Collection[str]) -> str:
        """Return a text that is one of some."""
        value = self.text(name)
        check_choice(name, value, accepted)
        return value

    def items(self, name: str, kind: type) -> list[Any]:
        """Return a list of values of a type, by default empty."""
        values = self.values.get(name, [])
        is_right = isinstance(values, list) and all(isinstance(own, kind) for own in values)
        if not is_right:
            raise ValueError(f"`{name}` must be a list of {kind.__name__}, got {values!r}")
        return values

    def points(self, name: str) -> list[list[float]]:
        """Return a list of points with two coordinates."""
        values = self.items(name, list)
        for own in values:
            numbers = [each for each in own if is_integer(each) or isinstance(each, float)]
            if len(own) != 2 or len(numbers) != 2:
                raise ValueError(f"`{name}` must have points of two numbers, got {own!r}")
        return values
