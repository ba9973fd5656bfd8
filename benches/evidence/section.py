"""The value that every section of the page is, and its text."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Table:
    """A table of the page; cells are text."""

    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""

    def lines(self):
        caption = [self.caption, ""] if self.caption else []
        return [
            *caption,
            "| " + " | ".join(self.head) + " |",
            "|" + "---|" * len(self.head),
            *("| " + " | ".join(row) + " |" for row in self.rows),
            "",
        ]


@dataclass(frozen=True)
class Section:
    """One question, what was measured, and what follows.

    The heading is the anchor with spaces and a capital, so that links to the anchor find it.
    `null` is what the measure gives if there is no effect, and how that was obtained. Each
    conclusion, each limit and each note is one sentence or two. A limit begins with "That" and
    states what does not follow; all other remarks on the tables are notes.
    """

    anchor: str
    title: str
    question: str
    data: str
    measure: str
    null: str
    tables: tuple[Table, ...]
    conclusions: tuple[str, ...]
    limits: tuple[str, ...]
    notes: tuple[str, ...] = ()

    def lines(self):
        described = {
            "Question": self.question,
            "Data": self.data,
            "Measure": self.measure,
            "Null": self.null,
        }
        lines = [heading(self.anchor), "", f"*{self.title}*", ""]
        for name, text in described.items():
            lines += [f"**{name}.** {text}", ""]
        for table in self.tables:
            lines += table.lines()
        lines += ["**What we conclude.**", "", *(f"- {text}" for text in self.conclusions), ""]
        lines += ["**What we do not conclude.**", "", *(f"- {text}" for text in self.limits), ""]
        if self.notes:
            lines += ["**Notes on the tables.**", "", *(f"- {text}" for text in self.notes), ""]
        return lines


def heading(anchor):
    """Return the heading that links to an anchor find."""
    return f"## {anchor.replace('-', ' ').capitalize()}"


def format_estimate(estimate, digits=2, scale=1.0, suffix="", *, has_n=True):
    """Return "0.07 (-0.11 to 0.29), n = 120" for the result of `Estimate.as_dict`, or a dash."""
    value, interval = estimate["value"], estimate["interval"]
    if value is None or not math.isfinite(value):
        return "-"
    text = f"{scale * value:.{digits}f}{suffix}"
    if interval is None:
        text += " (no interval)"
    else:
        low, high = (scale * end for end in interval)
        text += f" ({low:.{digits}f} to {high:.{digits}f})"
    return f"{text}, n = {estimate['n']}" if has_n else text


def verdict(estimate):
    """Return "above", "below" or "undecided": where the interval lies relative to 0."""
    interval = estimate["interval"]
    if interval is None or interval[0] <= 0 <= interval[1]:
        return "undecided"
    return "above" if interval[0] > 0 else "below"


def count_verdicts(estimates):
    """Return "above 0 in 2 of 5, below 0 in 1, undecided in 2"."""
    found = [verdict(estimate) for estimate in estimates]
    return (
        f"above 0 in {found.count('above')} of {len(found)} sources, below 0 in "
        f"{found.count('below')}, undecided in {found.count('undecided')}"
    )


def plain_reading(first, second, estimates):
    """Return a sentence on the differences of `first` less `second`, by name of the source."""
    found = {name: verdict(own) for name, own in estimates.items()}
    worse = [name for name, own in found.items() if own == "below"]
    n_better = sum(own == "above" for own in found.values())
    return (
        f"{first} is better than {second} in {n_better} of {len(found)} sources, worse in "
        f"{count_names(worse)}, and undecided in {len(found) - n_better - len(worse)}."
    )


def count_names(names):
    """Return "2 (a, b)", or "0"."""
    return f"{len(names)} ({', '.join(names)})" if names else "0"


def join_words(words):
    """Return "a, b and c"."""
    *others, last = words
    return f"{', '.join(others)} and {last}" if others else last
