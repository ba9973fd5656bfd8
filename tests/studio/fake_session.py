"""A session without motions, for tests of the server: it records calls and can fail."""

import queue
import threading


class FakeSession:
    """What `mograft.studio.session.Session` offers to the server."""

    def __init__(self):
        self.revision = 0
        self.calls = []
        self.error = None
        self.gate = threading.Event()
        self.gate.set()
        self._queues = []

    def __getattr__(self, name):
        def call(*arguments):
            self.gate.wait()
            self.calls.append((name, *arguments))
            if self.error is not None:
                raise self.error
            return {"call": name}

        if name in ("state", "figure", "character", "donors", "window", "export", "open"):
            return call
        raise AttributeError(name)

    def subscribe(self):
        self._queues.append(queue.SimpleQueue())
        return self._queues[-1]

    def tell(self, event):
        for own in self._queues:
            own.put(event)

    def do(self, action, revision):
        self.calls.append(("do", action, revision))
        if self.error is not None:
            raise self.error
        self.revision += 1
        self.tell({"kind": "state", "revision": self.revision})
        return {"revision": self.revision, "motions": [], "message": ""}
