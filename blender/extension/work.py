# SPDX-License-Identifier: GPL-3.0-or-later
"""Operators that compute in a thread: Blender stays usable, and Escape cancels."""

import threading
import traceback

import bpy

from mograft import MograftError

from .armature import RefusedError


class CancelledError(Exception):
    """The user pressed Escape."""


class Job(threading.Thread):
    """A function without data of Blender, its progress and its result."""

    def __init__(self, function):
        super().__init__(name="mograft", daemon=True)
        self.function, self.result, self.error = function, None, None
        self.stage, self.is_cancelled = "", False

    def run(self):
        """Call the function; it reports its progress, which also ends it after a cancellation."""
        try:
            self.result = self.function(self.report)
        except BaseException as error:
            self.error = error

    def report(self, stage, done, total):
        """Store the progress; raise CancelledError if the job was cancelled."""
        if self.is_cancelled:
            raise CancelledError
        self.stage = f"{stage} {done} of {total}"


class WorkOperator:
    """Base class: `prepare` and `finish` use data of Blender, the function between them does not.

    `prepare` returns the function of a job. `finish` gets its result.
    """

    _job = _timer = None
    _is_running = False

    def execute(self, context):
        """Do all in this call, as for scripts and without a window."""
        try:
            job = Job(self.prepare(context))
        except Exception as error:
            return self._refuse(error)
        job.run()
        return self._end(context, job)

    def invoke(self, context, _event):
        """Start the job; `modal` waits for it."""
        if bpy.app.background or context.window is None:
            return self.execute(context)
        if WorkOperator._is_running:
            self.report({"WARNING"}, "mograft is already working: press Escape to cancel")
            return {"CANCELLED"}
        try:
            self._job = Job(self.prepare(context))
        except Exception as error:
            return self._refuse(error)
        self._job.start()
        WorkOperator._is_running = True
        manager = context.window_manager
        self._timer = manager.event_timer_add(0.1, window=context.window)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """Show the progress; end when the job has ended."""
        if event.type == "ESC":
            self.cancel(context)  # the thread ends when it reports its progress
            return self._refuse(CancelledError())
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        if self._job.is_alive():
            context.workspace.status_text_set(f"mograft: {self._job.stage} (Escape cancels)")
            return {"PASS_THROUGH"}
        self.cancel(context)
        return self._end(context, self._job)

    def cancel(self, context):
        """Stop the job; Blender calls this, too, if the file is closed."""
        self._job.is_cancelled = True
        WorkOperator._is_running = False
        context.window_manager.event_timer_remove(self._timer)
        if context.workspace is not None:
            context.workspace.status_text_set(None)

    def warn(self, notes):
        """Report warnings."""
        for own in notes:
            self.report({"WARNING"}, own)

    def _end(self, context, job):
        try:
            if job.error is not None:
                raise job.error
            self.finish(context, job.result)
        except Exception as error:
            return self._refuse(error)
        return {"FINISHED"}

    def _refuse(self, error):
        """Report an error, and return the result of an operator that changed nothing."""
        if isinstance(error, CancelledError):
            self.report({"INFO"}, "mograft: cancelled")
            return {"CANCELLED"}
        text = str(error) or type(error).__name__
        if not isinstance(error, RefusedError | MograftError | ValueError | MemoryError):
            traceback.print_exception(error)
            text = f"Unexpected error: {text}"
        self.report({"ERROR"}, text)
        return {"CANCELLED"}
