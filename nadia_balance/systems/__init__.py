"""Drake LeafSystems: one per file, one algorithm per LeafSystem."""
