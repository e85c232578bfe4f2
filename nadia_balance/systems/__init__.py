"""Drake LeafSystems, one per file; signals.py has the units of their ports."""
