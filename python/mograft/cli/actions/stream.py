"""``mograft stream``: serve live grafts to engines on a local socket."""

import argparse
import sys

from mograft.cli.configuration import load_library
from mograft.cli.output import print_remark, print_result
from mograft.stream.protocol import PROTOCOL
from mograft.stream.server import ServerLimits, StreamServer, is_loopback


def run(options: argparse.Namespace) -> int:
    """Run the command until it is interrupted."""
    library = load_library(options)
    address = options.socket if options.socket is not None else (options.host, options.port)
    if options.socket is None and not is_loopback(options.host):
        print_remark(
            f"warning: {options.host} accepts connections from other computers, without a password"
        )
    server = StreamServer(library, address, ServerLimits(idle_seconds=options.timeout))
    document = {"protocol": PROTOCOL, "address": server.address, "rate": library.rate}
    lines = [f"{PROTOCOL} at {server.address}, {library.rate:.6g} frames/s; Ctrl-C ends it"]
    print_result(options, "stream-server", document, lines)
    sys.stdout.flush()
    server.serve_forever()
    return 0
