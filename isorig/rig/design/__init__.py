"""`rig design`: parameters that may vary, and the moves of the wire bonder."""
