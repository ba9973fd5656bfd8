"""The Python client in examples/stream, and the programs that compile the other clients."""

import sys
from pathlib import Path

EXAMPLES = Path(__file__).parents[1] / "examples" / "stream"
sys.path.insert(0, str(EXAMPLES))
from stream_client import StreamClient, StreamError  # noqa: E402 - a script beside the package

__all__ = ["EXAMPLES", "StreamClient", "StreamError"]
