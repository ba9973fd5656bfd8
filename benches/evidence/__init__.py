"""The experiments of ``docs/evidence.md``: one module for each section.

A section module has these names. `EXPERIMENTS` in `benches.evidence.page` lists the modules in the
order of the page.

- ``NAME``: anchor of the section on the page, such as ``"retrieval"``.
- ``SOURCES``: names of the sources (`benches.evidence.sources.SOURCES`) that it measures.
- ``HELPERS`` (optional): modules of benches on whose code the results depend.
- ``measure(recordings, *, is_quick)``: returns a JSON value for one `Recordings`. It may raise
  `mograft.InsufficientDataError`; the page then lists the source with the reason. Results are
  stored, so that an interrupted run continues where it stopped.
- ``render(results)``: returns the `Section`, given the JSON values by name of the source. Values of
  some sources may be missing.

Numbers with intervals are stored as ``Estimate.as_dict()`` and formatted by `format_estimate`.
"""
