"""The files of a library folder: arrays, database and manifest."""
