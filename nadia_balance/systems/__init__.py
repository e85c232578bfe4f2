"""One Drake LeafSystem a file, one algorithm a LeafSystem."""
