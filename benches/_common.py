"""Code that all benches share: the run of a report, and the option `--tiny`."""

import contextlib
import io
import os
import sys
import warnings
from pathlib import Path

from mograft import _core
from mograft.dancer import dance


def run(parser, report, argv, *, is_timing=False):
    """Parse the command line, and call `report` with the options; return its result.

    Adds the option ``--tiny``, with which the tests run every bench: `report` then takes a small
    generated input, and its output is discarded. A bench that times refuses a debug build.
    """
    parser.add_argument(
        "--tiny",
        action="store_true",
        help="test the bench: run every step on a small generated input, and print no figures",
    )
    options = parser.parse_args(argv)
    if is_timing and _core.BUILD_PROFILE != "release" and not options.tiny:
        sys.exit(f"refusing to time a {_core.BUILD_PROFILE} build: maturin develop --release")
    output = io.StringIO() if options.tiny else sys.stdout
    with warnings.catch_warnings(), contextlib.redirect_stdout(output):
        warnings.simplefilter("ignore")
        return report(options)


def tiny_motion(seed=1, n_frames=240):
    """Return a few seconds of the dancer."""
    return dance(seed=seed, strides=1).motion[:n_frames]


def resident_bytes(process_id=None):
    """Return the resident memory of a process, or None if the system does not state it."""
    status = Path(f"/proc/{process_id or os.getpid()}/status")
    if not status.exists():
        return None
    line = next(own for own in status.read_text().splitlines() if own.startswith("VmRSS"))
    return int(line.split()[1]) * 1024
