"""The memory of processes that tests start."""

PEAK_BYTES = '''
def peak_bytes():
    """Return the largest resident memory of this process so far."""
    try:
        with open("/proc/self/status") as status:
            return next(int(line.split()[1]) << 10 for line in status if line.startswith("VmHWM"))
    except OSError:
        import resource, sys
        unit = 1 if sys.platform == "darwin" else 1024
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit
'''
"""A function for programs of tests.

On Linux, `ru_maxrss` of a new process begins with the memory of the process that started it, which
depends on the tests that have run in it.
"""
