//! Exact complete linkage: points in, tree or labels out; nothing here knows of motion.
