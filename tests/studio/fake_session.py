"""A session without motions, for tests of the server: it records calls and can fail."""

import threading


class FakeSession:
    """What `mograft.studio.session.Session` offers to the server."""

    def __init__(self):
        self.revision = 0
        self.calls = []
        self.error = None
        self.gate = threading.Event()
        self.gate.set()
        self._listeners = []

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

    def subscribe(self, listener):
        self._listeners.append(listener)

    def tell(self, event):
        for listener in self._listeners:
            listener(event)

    def do(self, action, revision):
        self.calls.append(("do", action, revision))
        if self.error is not None:
            raise self.error
        self.revision += 1
        self.tell({"kind": "state", "revision": self.revision})
        return {"revision": self.revision, "motions": [], "message": ""}
