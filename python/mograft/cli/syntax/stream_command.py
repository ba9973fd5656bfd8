"""The declaration of ``mograft stream``."""

from pathlib import Path

from mograft.cli.syntax.arguments import command, exclusive, option, setting
from mograft.cli.syntax.options import (
    FILES_OR_LIBRARY,
    GROUPS,
    INCLUDE_GRAFTS,
    JSON,
    MATCH,
    SEGMENTATION,
    SKELETON,
    VARIETY,
)
from mograft.cli.syntax.values import port, positive_number

STREAM = command(
    "stream",
    "serve grafts of a motion that arrives frame by frame to game engines and other programs",
    FILES_OR_LIBRARY,
    INCLUDE_GRAFTS,
    MATCH,
    SKELETON,
    GROUPS,
    SEGMENTATION,
    VARIETY,
    exclusive(
        option("--port N", "TCP port from 0 to 65535; 0 selects a free port", port),
        option("--socket PATH", "path of a Unix socket to create", Path, is_path=True),
    ),
    setting(
        "--host ADDRESS",
        "address at which the TCP port is open (default: 127.0.0.1, which only this computer can "
        "reach)",
        str,
        "127.0.0.1",
    ),
    setting(
        "--timeout SECONDS",
        "pause between two messages, in seconds, after which a connection is closed (default: 600)",
        positive_number,
        600.0,
    ),
    JSON,
    description="Serve streams of grafts, as mograft.Stream makes them, with the protocol "
    "mograft.stream/1. The command prints one line with the address, and runs until it is "
    "interrupted.",
)
