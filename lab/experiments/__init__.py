"""The experiments on recordings: one module for each, whose tables are in ``lab/results``.

A module of an experiment has these names. `EXPERIMENTS` in `lab.experiments.run` lists the modules.

- ``NAME``: beginning of the names of its CSV files, such as ``"retrieval"``.
- ``SOURCES``: names of the sources (`lab.experiments.sources.SOURCES`) that it measures.
- ``measure(recordings, *, is_quick)``: returns a JSON value for one `Recordings`. It may raise
  `mograft.InsufficientDataError`. Results are stored, so that an interrupted run continues where it
  stopped.
- ``tables(results)``: returns the tables by name, given the JSON values by name of the source.
  Values of some sources may be missing.

Numbers with intervals are stored as ``Estimate.as_dict()`` and formatted by `format_estimate`.
"""
