"""The far ends of the wires: simulated instruments. What they play is handed to them."""
