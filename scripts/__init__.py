"""The programs of this package: `push`, `simulate`, `envelope` and others."""
