"""Code that the studies share: the run of a report, the option `--quick`, and keys in JSON."""

import contextlib
import io
import sys
import warnings
from collections.abc import Mapping
from typing import ClassVar

from mograft.dancer import dance
from mograft.evaluation.estimate import Record


def run(parser, report, argv):
    """Parse the command line, and call `report` with the options; return its result.

    Adds the option ``--tiny``, with which the tests run every study: `report` then takes a small
    generated input, and its output is discarded.
    """
    parser.add_argument(
        "--tiny",
        action="store_true",
        help="test the study: run every step on a small generated input, and print no figures",
    )
    options = parser.parse_args(argv)
    output = io.StringIO() if options.tiny else sys.stdout
    with warnings.catch_warnings(), contextlib.redirect_stdout(output):
        warnings.simplefilter("ignore")
        return report(options)


def tiny_motion(seed=1, n_frames=240):
    """Return a few seconds of the dancer."""
    return dance(seed=seed, strides=1).motion[:n_frames]


class RenamedRecord(Record):
    """Base class of results of which some fields have another name in JSON."""

    JSON_KEYS: ClassVar[Mapping[str, str]] = {}  # field name to JSON key

    def as_dict(self):
        """Return a dict for JSON, with the fields in their order."""
        return {self.JSON_KEYS.get(name, name): own for name, own in super().as_dict().items()}
