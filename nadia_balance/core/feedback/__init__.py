"""ICP feedback: by the CoP, the angular momentum, the next steps."""
