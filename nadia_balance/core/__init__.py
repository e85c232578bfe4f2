"""Pure mathematics of the papers: no systems, no plant, no clock."""
