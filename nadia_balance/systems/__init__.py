"""Drake LeafSystems, by rooms of core; signals.py has their ports' units."""
