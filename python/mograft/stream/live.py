"""Live motions over VMC: `play` sends a motion, and `Relay` grafts the base of a sender."""

import select
import socket
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from itertools import count
from typing import Any

import numpy as np

from mograft._util.arrays import FloatArray
from mograft.errors import join_names
from mograft.library.library import Library
from mograft.motion import rotations
from mograft.motion.motion import Motion
from mograft.stream.osc import decode
from mograft.stream.stream import Stream
from mograft.stream.vmc import Figure, Place, leg_length, read_bones
from mograft.synthesis.newness import NEW_ANGLE

Address = tuple[str, int]
Frame = tuple[FloatArray, FloatArray]
"""Rotations of all joints, and the position of the joint that carries the body."""

_MAX_PACKET = 65_536
_MAX_PACKETS_PER_SECOND = 1_000  # others are dropped; a sender of two packets a frame has 240
_HOLD_SECONDS = 0.5  # after the last packet, from when on the base is held
_JUMP_SECONDS = 1.0  # between two frames, from which on the clock of the sender was set
_SNAP = 0.02  # of a frame interval: times of VMC have single precision
_CATCH_UP = 0.97  # length of frame intervals while more than `_QUEUE_SECONDS` of frames wait
_QUEUE_SECONDS = 1.5
_NEW_SECONDS = 10.0
_OWNER_SECONDS = 2.0  # of silence, after which another sender is heard


class Sender:
    """A UDP socket that sends packets to one address; a receiver that is gone does no harm."""

    def __init__(self, address: Address) -> None:
        kind = (socket.AF_UNSPEC, socket.SOCK_DGRAM)
        try:
            family, *_, target = socket.getaddrinfo(*address, *kind)[0]
        except OSError as error:
            raise OSError(error.errno, error.strerror, address[0]) from None
        self._target: Any = target
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self.n_lost = 0  # packets that the system did not accept

    def send(self, packet: bytes) -> None:
        """Send a packet."""
        try:
            self._socket.sendto(packet, self._target)
        except OSError:
            self.n_lost += 1

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


def play(
    motion: Motion,
    sender: Sender,
    wait: Callable[[float], bool],
    *,
    speed: float = 1.0,
    loop: bool = False,
) -> int:
    """Send the frames of a motion at their times, and return their number.

    `wait` waits some seconds and returns whether the motion pauses. The time of each frame follows
    from its number, so that errors of the clock do not add up.
    """
    figure, step = Figure(motion), motion.frame_time / speed
    start, n_sent = time.monotonic(), 0
    for turn in count() if loop else range(1):
        for packet in figure.packets(motion, turn * motion.n_frames * step, step):
            while (left := start + n_sent * step - time.monotonic()) > 0:
                if wait(left):
                    begin = time.monotonic()
                    while not wait(1.0):
                        sender.send(packet)  # a receiver that is started now shows the pose
                    start += time.monotonic() - begin
            sender.send(packet)
            n_sent += 1
    return n_sent


class Receiver:
    """A UDP socket that reads the bones of one VMC sender, and counts what it drops."""

    def __init__(self, address: Address) -> None:
        family = socket.AF_INET6 if ":" in address[0] else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        try:
            self._socket.bind(address)
        except OSError as error:
            self._socket.close()
            raise OSError(error.errno, error.strerror, f"{address[0]}:{address[1]}") from None
        self._socket.settimeout(0.0)
        self.dropped = Counter[str]()  # packets or messages, by reason
        self._owner: tuple[object, float] = (None, -np.inf)
        self._second, self._n_in_second = 0, 0
        self._bones: dict[str, Place] = {}
        self._last_time: float | None = None

    @property
    def port(self) -> int:
        """The port of the socket."""
        return int(self._socket.getsockname()[1])

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def forget(self) -> None:
        """Forget the sender, its bones and its clock."""
        self._bones, self._last_time, self._owner = {}, None, (None, -np.inf)

    def frames(self, seconds: float) -> Iterator[tuple[float, Mapping[str, Place]]]:
        """Wait for packets; yield the time and the bones of each frame that has arrived."""
        if not select.select([self._socket], [], [], max(seconds, 0.0))[0]:
            return
        for _ in range(_MAX_PACKETS_PER_SECOND):
            try:
                packet, source = self._socket.recvfrom(_MAX_PACKET)
            except BlockingIOError:
                return
            except OSError:  # on Windows, of a packet that was sent before
                continue
            frame = self._read(packet, source, time.monotonic())
            if frame is not None:
                yield frame

    def _read(
        self, packet: bytes, source: object, now: float
    ) -> tuple[float, Mapping[str, Place]] | None:
        """Return the time and the bones after a packet, if it completes a frame."""
        owner, heard = self._owner
        if owner not in (None, source) and now - heard < _OWNER_SECONDS:
            self.dropped["of another sender"] += 1
            return None
        if int(now) != self._second:
            self._second, self._n_in_second = int(now), 0
        self._n_in_second += 1
        if self._n_in_second > _MAX_PACKETS_PER_SECOND:
            self.dropped["too many"] += 1
            return None
        return self._read_own(packet, source, now)

    def _read_own(
        self, packet: bytes, source: object, now: float
    ) -> tuple[float, Mapping[str, Place]] | None:
        try:
            bones, at, n_invalid = read_bones(decode(packet))
        except ValueError:
            self.dropped["invalid"] += 1
            return None
        if n_invalid:
            self.dropped["invalid"] += n_invalid
        if not bones and at is None:
            return None
        self._owner = (source, now)
        last = self._last_time
        if at is not None and last is not None and last - _JUMP_SECONDS < at <= last:
            self.dropped["late"] += at < last
            return None
        self._bones = self._bones | bones
        # A sender without times sends all bones in one packet.
        is_complete = at is not None or (last is None and "Hips" in bones)
        if at is not None:
            self._last_time = at
        return (now if at is None else at, self._bones) if is_complete else None


@dataclass
class Resampler:
    """Frames of a sender at a constant rate, interpolated between the two frames beside each."""

    rate: float
    n_frames: int = 0  # that were made
    _last: tuple[float, Frame] | None = field(default=None, init=False)
    _shift: float = field(default=0.0, init=False)  # from the time of the sender to that of frames

    def push(self, at: float, frame: Frame) -> Iterator[Frame]:
        """Yield the frames up to the time `at` of the sender, in seconds."""
        place = (at + self._shift) * self.rate
        if self._last is None or abs(at + self._shift - self._last[0]) > _JUMP_SECONDS:
            self._shift = self.n_frames / self.rate - at
            place, self._last = self.n_frames, None
        before = self._last or (0.0, frame)
        self._last = (at + self._shift, frame)
        start = before[0] * self.rate
        while self.n_frames <= place + _SNAP:
            share = 1.0 if place <= start else (self.n_frames - start) / (place - start)
            self.n_frames += 1
            yield _between(before[1], frame, share if abs(1.0 - share) > _SNAP else 1.0)

    def hold(self, n_frames: int) -> Iterator[Frame]:
        """Yield the last frame again; the next one that is pushed follows, whatever its time."""
        if self._last is not None:
            frame = self._last[1]
            self._last = (-np.inf, frame)
            self.n_frames += n_frames
            yield from [frame] * n_frames


def _between(first: Frame, second: Frame, share: float) -> Frame:
    if share == 1.0:
        return second
    turns = rotations.continuous_signs(np.stack([first[0], second[0]]))
    turn = rotations.log(rotations.multiply(rotations.inverse(turns[0]), turns[1]))
    quats = rotations.multiply(turns[0], rotations.exp(share * turn))
    return quats, first[1] + share * (second[1] - first[1])


class Relay:
    """Grafts of the base that a VMC sender sends, sent to a VMC receiver while it arrives."""

    def __init__(
        self,
        library: Library,
        receiver: Receiver,
        sender: Sender,
        remark: Callable[[str], object],
        *,
        timeout: float = 600.0,
        **options: int | float,
    ) -> None:
        self._library, self._receiver, self._sender = library, receiver, sender
        self._remark, self._timeout, self._options = remark, timeout, options
        self._figure = Figure(library.clips[0])
        self._step = 1.0 / library.rate
        if self._figure.absent:
            remark(f"left out, because the library lacks them: {join_names(self._figure.absent)}")
        self.n_base = self.n_sent = 0
        self._is_new: deque[bool] = deque(maxlen=round(_NEW_SECONDS * library.rate))
        self._restart()
        self._joints = np.concatenate([library.joints(own) for own in self._stream.groups])

    def _restart(self) -> None:
        """Prepare for the first frame of a sender."""
        self._stream = Stream(self._library, **self._options)  # type: ignore[arg-type]
        self._resampler = Resampler(self._library.rate)
        self._leg: float | None = None
        self._base: deque[FloatArray] = deque()  # rotations of frames that are not committed
        self._queue: deque[bytes] = deque()
        self._due = self._heard = -np.inf

    @property
    def dropped(self) -> Mapping[str, int]:
        """The numbers of packets or messages that were dropped, by reason."""
        return {**self._receiver.dropped, "not sent": self._sender.n_lost}

    @property
    def newness(self) -> float:
        """The share of the frames of ten seconds in which a joint is new."""
        return float(np.mean(self._is_new)) if self._is_new else 0.0

    def status(self) -> str:
        """Return what the relay has done, in one line."""
        behind = (len(self._base) + len(self._queue)) * self._step
        reasons = ", ".join(f"{n} {reason}" for reason, n in self.dropped.items() if n)
        return (
            f"base {self.n_base} frames, new {self.n_sent}, {behind:.1f} s behind, "
            f"{self.newness:.0%} new, dropped {sum(self.dropped.values())}"
            + (f" ({reasons})" if reasons else "")
        )

    def run(self, show: Callable[[str], object] | None = None) -> None:
        """Relay until an exception ends it; call `show` with the status once a second."""
        next_status = time.monotonic() + 1.0
        while True:
            self.advance()
            if show is not None and time.monotonic() >= next_status:
                next_status += 1.0
                show(self.status())

    def advance(self, seconds: float = 0.05) -> None:
        """Receive frames for at most some seconds, and send those that are due."""
        now = time.monotonic()
        wait = min(seconds, self._due - now) if self._queue else seconds
        for at, bones in self._receiver.frames(wait):
            if "Hips" in bones:
                self._push_bones(at, bones)
        now = time.monotonic()
        silence = now - self._heard
        if self._heard > 0 and silence > self._timeout:
            self._end()
        elif self._heard > 0 and (n := int((now - self._held_until) / self._step)) > 0:
            self._push(self._resampler.hold(n))
            self._held_until += n * self._step
        self._send_due()

    def _push_bones(self, at: float, bones: Mapping[str, Place]) -> None:
        """Append the frames up to that of some bones."""
        if self._heard < 0:
            self._leg = leg_length(bones)
            missing = [own for own in self._figure.bones if own not in bones]
            if missing:
                self._remark(f"at rest, because the sender lacks them: {join_names(missing)}")
        self._heard = time.monotonic()
        self._held_until = self._heard + _HOLD_SECONDS
        frame = self._figure.pose(bones, self._leg, self._library.root)
        self._push(self._resampler.push(at, frame))

    def _push(self, frames: Iterable[Frame]) -> None:
        for quats, place in frames:
            self._stream.push(quats, place)
            self._base.append(quats)
            self.n_base += 1
        self._queue_pieces()

    def _queue_pieces(self) -> None:
        for piece in self._stream.pieces():
            motion = piece.motion
            base = np.stack([self._base.popleft() for _ in range(motion.n_frames)])
            angles = rotations.angle(base[:, self._joints], motion.rotations[:, self._joints])
            self._is_new.extend((angles > NEW_ANGLE).any(axis=1).tolist())
            if not self._queue and self._due < time.monotonic():
                self._due = time.monotonic()
            self._queue.extend(self._figure.packets(motion, piece.start * self._step, self._step))

    def _send_due(self) -> None:
        while self._queue and self._due <= time.monotonic():
            self._sender.send(self._queue.popleft())
            self.n_sent += 1
            is_late = len(self._queue) * self._step > _QUEUE_SECONDS
            self._due += self._step * (_CATCH_UP if is_late else 1.0)

    def _end(self) -> None:
        """Send what is left of a base whose sender has stopped, and wait for another one."""
        if self._stream.n_known > 1:
            self._stream.close()
            self._queue_pieces()
        while self._queue:
            time.sleep(max(self._due - time.monotonic(), 0.0))
            self._send_due()
        self._remark(f"the sender stopped {self._timeout:g} s ago; the next one starts anew")
        self._receiver.forget()
        self._restart()
