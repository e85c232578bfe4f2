"""What is drawn and clicked in Meshcat."""
