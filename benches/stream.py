"""Latency of `mograft stream`: the time of replies over a socket, and of calls in the process.

The last line has the intervals between the packets of `mograft play`, and how late each is.

    python benches/stream.py

The client sends one frame at a time and waits for the reply; the server is another process.
"""

import argparse
import json
import socket
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import chdir, closing, contextmanager
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples" / "stream"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from stream_client import StreamClient

import mograft as mg
from benches._common import run
from mograft.dancer import dance
from mograft.stream.live import Sender, play

HORIZONS = (1, 8)


@contextmanager
def serve(library, *words):
    """Run ``mograft stream`` on a library in a folder; yield its address."""
    command = [sys.executable, "-m", "mograft", "stream", library, *words, "--json"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            text = ""
            while not text.endswith("}\n"):
                line = process.stdout.readline()
                if not line:
                    raise OSError(f"{' '.join(command)} ended: see its error above")
                text += line
            yield json.loads(text)["address"]
        finally:
            process.kill()


def time_pushes(push, base):
    """Push all frames; return the seconds of each push, and the first free frame after it."""
    seconds, free = [], []
    for frame in range(base.n_frames):
        start = time.perf_counter()
        free.append(push(base.rotations[frame : frame + 1], base.positions[frame : frame + 1]))
        seconds.append(time.perf_counter() - start)
    return np.array(seconds), np.array(free)


def time_socket(address, base, horizon):
    """Return the results of `time_pushes` for a client of a server, in float32."""
    host, _, port = address.rpartition(":")
    with StreamClient((host, int(port))) as client:
        client.request({"type": "hello", "protocol": "mograft.stream/1", "horizon": horizon})

        def push(rotations, positions):
            header, _ = client.request(
                {"type": "push"},
                rotations=rotations.astype(np.float32),
                positions=positions.astype(np.float32),
            )
            return header["first_free_frame"]

        return time_pushes(push, base)


def time_calls(library, base, horizon):
    """Return the results of `time_pushes` for a stream in this process."""
    stream = mg.Stream(library, horizon=horizon)

    def push(rotations, positions):
        stream.push(rotations, positions)
        stream.pieces()
        return stream.first_free_frame

    return time_pushes(push, base)


def print_row(name, seconds, free, rate):
    has_piece = np.diff(free, prepend=0) > 0
    cells = []
    for own in (seconds[~has_piece], seconds[has_piece]):
        values = np.percentile(own, [50, 99, 100]) * 1e3 if len(own) else [np.nan] * 3
        cells.append(" ".join(f"{value:7.2f}" for value in values))
    newest = np.arange(len(free))[has_piece]
    delay = np.median(newest - (free[has_piece] - 1)) / rate if len(newest) else np.nan
    print(f"{name:28} {cells[0]}   {cells[1]}   {delay:8.2f}")


def print_jitter(motion):
    """Print by how many milliseconds packets of a motion are later than their times."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        out.bind(("127.0.0.1", 0))
        out.settimeout(60.0)
        with closing(Sender(("127.0.0.1", out.getsockname()[1]))) as sender:
            words = (motion, sender, lambda seconds: time.sleep(seconds))
            thread = threading.Thread(target=play, args=words)
            thread.start()
            arrivals = np.array(
                [(out.recv(65_536), time.perf_counter())[1] for _ in motion.rotations]
            )
            thread.join()
    late = (arrivals - arrivals[0] - np.arange(len(arrivals)) * motion.frame_time) * 1e3
    late -= late.min()
    values = np.percentile(late, [50, 99, 100])
    print(f"{'VMC, play: late':28} {' '.join(f'{value:7.2f}' for value in values)}")


def report(options):
    n_dances, n_frames = (1, 240) if options.tiny else (13, None)
    with tempfile.TemporaryDirectory() as folder, chdir(folder):
        path = "dances.mograft"
        mg.Library.build([dance(seed=s).motion[:n_frames] for s in range(n_dances)]).save(path)
        library, base = mg.Library.open(path), dance(seed=99).motion[:n_frames]
        print(f"{library}, {base.n_frames} frames\n")
        print(
            f"{'ms: median, 99 %, maximum':28} {'without piece':23}   {'with piece':23}   s behind"
        )
        with serve(path, "--port", "0") as address:
            for horizon in HORIZONS:
                for name, times in (
                    ("calls", time_calls(library, base, horizon)),
                    ("TCP", time_socket(address, base, horizon)),
                ):
                    print_row(f"{name}, horizon {horizon}", *times, library.rate)
        print_jitter(base[: 60 if options.tiny else 900])


def main(argv=None):
    return run(argparse.ArgumentParser(description=__doc__), report, argv, is_timing=True)


if __name__ == "__main__":
    main()
