"""Limits of the model; no controller reads them."""
