"""`SegmentationMethod`: how a method of segmentation finds cut frames, and its parameters."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Any

from mograft._util.arrays import IntArray
from mograft.errors import suggest_name
from mograft.motion.motion import Motion


@dataclass(frozen=True)
class SegmentationMethod:
    """A method of segmentation; `METHODS` of `segmentation` has them."""

    parameters: type[Any]  # a frozen dataclass, all of whose fields have defaults
    cut_frames: Callable[[Motion, Any], IntArray]
    """Returns the inner cut frames of a motion of at least two frames, ascending, given the
    parameters. The caller adds both ends, and merges segments shorter than `Config.min_length`."""

    def make_parameters(self, name: str, given: Mapping[str, Any]) -> Any:  # noqa: ANN401 - of any method
        """Return the parameters with the values in `given`, and the defaults for all others.

        `name` is the name of the method, for messages. Raises ValueError if the method has no
        parameter of a given name, and the error of the dataclass if a value is out of range.
        """
        known = [field.name for field in fields(self.parameters)]
        for key in given:
            if key not in known:
                accepted = ", ".join(map(repr, known)) or "none"
                raise ValueError(
                    f"parameters of segmentation {name!r} must be among {accepted}, got {key!r}"
                    f"{suggest_name(key, known)}"
                )
        return self.parameters(**given)
