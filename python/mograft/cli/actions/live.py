"""``mograft play`` and ``mograft stream``: motions that are sent while they play or arrive."""

import os
import select
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial

from mograft import Library
from mograft._util.signals import clean_up_by
from mograft.cli.configuration import load_library, selected_skeleton
from mograft.cli.files import shell_names
from mograft.cli.output import print_remark, print_result, write_control
from mograft.cli.syntax.arguments import UsageError
from mograft.cli.syntax.commands import PlayOptions, StreamOptions
from mograft.errors import join_names
from mograft.io.formats import find_addresses, read_clip
from mograft.stream.live import Receiver, Relay, Sender, play
from mograft.stream.server import StreamServer, is_loopback
from mograft.stream.session import PROTOCOL
from mograft.stream.vmc import Figure


def run_play(options: PlayOptions) -> int:
    """Send a motion over VMC until it ends or the command is interrupted."""
    addresses = [own for name in options.files for own in find_addresses(name)]
    if len(addresses) != 1:
        n, names = len(addresses), shell_names(addresses)
        raise ValueError(f"play sends one motion, got {n}: give one of {names}")
    motion = read_clip(addresses[0], skeleton=selected_skeleton(options))
    target, figure = _text(options.vmc), Figure(motion)
    if not options.json:
        print_remark(f"{motion.name}: {motion.rate * options.speed:.6g} frames/s to {target}")
        if figure.absent:
            print_remark(f"left out, because the file lacks them: {join_names(figure.absent)}")
    with closing(Sender(options.vmc)) as sender, _keys() as wait:
        n = play(motion, sender, wait, speed=options.speed, loop=options.loop)
    document = {"file": addresses[0], "address": target, "frames": n, "bones": figure.bones}
    lines = [f"{n} frames sent, {sender.n_lost} refused by the system"]
    print_result(options, "play/1", {**document, "refused": sender.n_lost}, lines)
    return 0


def run_stream(options: StreamOptions) -> int:
    """Serve grafts of a motion that arrives, until the command is interrupted."""
    if options.vmc is None and options.vmc_in is not None:
        raise UsageError("--vmc-in requires --vmc")
    if options.vmc is not None and options.vmc_in is None:
        raise UsageError("--vmc requires --vmc-in: clients of --port receive the new motion")
    if (options.port is None) == (options.vmc_in is None):
        given = "none" if options.port is None else "both"
        raise UsageError(f"one of --port and --vmc-in is required, got {given}")
    library = load_library(options)
    if options.vmc is not None and options.vmc_in is not None:
        _relay(library, options.vmc_in, options.vmc, options)
        return 0
    if not is_loopback(options.host):
        print_remark(
            f"warning: {options.host} accepts connections from other computers, without a password"
        )
    server = StreamServer(library, (options.host, options.port or 0), options.timeout)
    document = {"protocol": PROTOCOL, "address": server.address, "rate": library.rate}
    lines = [f"{PROTOCOL} at {server.address}, {library.rate:.6g} frames/s; Ctrl-C ends it"]
    print_result(options, "stream-server/1", document, lines)
    sys.stdout.flush()
    server.serve_forever()
    return 0


def _relay(
    library: Library, source: tuple[str, int], target: tuple[str, int], options: StreamOptions
) -> None:
    """Graft the base of a VMC sender until the command is interrupted."""
    if not is_loopback(source[0]):
        print_remark(f"warning: {source[0]} accepts motions from other computers")
    with closing(Receiver(source)) as receiver, closing(Sender(target)) as sender:
        live = Relay(
            library, receiver, sender, print_remark, timeout=options.timeout, delay=options.delay
        )
        address = _text((source[0], receiver.port))
        document = {"protocol": "VMC", "address": address, "target": _text(target)}
        lines = [f"VMC from {address} to {document['target']}; Ctrl-C ends it"]
        print_result(options, "stream-server/1", {**document, "rate": library.rate}, lines)
        print_remark(f"delay {options.delay:g} s: with a smaller one fewer parts are compared")
        sys.stdout.flush()
        live.run(partial(print_remark, is_result=True) if options.status else None)


def _text(address: tuple[str, int]) -> str:
    host, port = address
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _sleep(seconds: float) -> bool:
    time.sleep(seconds)
    return False


@contextmanager
def _keys() -> Iterator[Callable[[float], bool]]:
    """Yield a function that waits some seconds and returns whether the space bar was pressed."""
    terminal = 0
    # A process in the background must not change the terminal.
    if os.name == "nt" or not os.isatty(terminal) or os.tcgetpgrp(terminal) != os.getpgrp():
        yield _sleep
        return
    import termios
    import tty

    saved = termios.tcgetattr(terminal)

    def wait(seconds: float) -> bool:
        if not select.select([terminal], [], [], seconds)[0]:
            return False
        is_space = os.read(terminal, 1) == b" "
        if is_space:
            write_control("\r\033[Kpaused or playing: the space bar switches\r")
        return is_space

    # A signal may end the process within the block.
    with clean_up_by(lambda: termios.tcsetattr(terminal, termios.TCSADRAIN, saved)):
        tty.setcbreak(terminal)
        yield wait
