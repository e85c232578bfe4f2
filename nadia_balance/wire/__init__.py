"""The boundary to a robot: messages, wires, and a process that balances it."""
