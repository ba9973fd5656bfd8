"""The result of an experiment."""

from dataclasses import dataclass, field


@dataclass
class Outcome:
    """The number of trials and one message per failure."""

    trials: int = 0
    failures: list[str] = field(default_factory=list)

    def add(self, other):
        """Add the trials and failures of another outcome."""
        self.trials += other.trials
        self.failures += other.failures
