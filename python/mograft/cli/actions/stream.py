"""``mograft stream``: serve live grafts to engines on a local socket."""

import sys

from mograft.cli.configuration import load_library
from mograft.cli.output import print_remark, print_result
from mograft.cli.syntax.arguments import UsageError
from mograft.cli.syntax.commands import StreamOptions
from mograft.stream.server import ServerLimits, StreamServer, is_loopback
from mograft.stream.session import PROTOCOL


def run(options: StreamOptions) -> int:
    """Run the command until it is interrupted."""
    if (options.port is None) == (options.socket is None):
        raise UsageError("one of --port and --socket is required")
    library = load_library(options)
    address = options.socket or (options.host, options.port or 0)
    if options.socket is None and not is_loopback(options.host):
        print_remark(
            f"warning: {options.host} accepts connections from other computers, without a password"
        )
    server = StreamServer(library, address, ServerLimits(idle_seconds=options.timeout))
    document = {"protocol": PROTOCOL, "address": server.address, "rate": library.rate}
    lines = [f"{PROTOCOL} at {server.address}, {library.rate:.6g} frames/s; Ctrl-C ends it"]
    print_result(options, "stream-server/1", document, lines)
    sys.stdout.flush()
    server.serve_forever()
    return 0
