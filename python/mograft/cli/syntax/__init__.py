"""Commands, options and values of the command line; imports no NumPy."""
