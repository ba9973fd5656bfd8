"""Packages that are distributed separately, too; they import nothing of mograft but its kernels."""
