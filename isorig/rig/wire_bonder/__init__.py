"""The wire bonder: its description, and everything that is computed for it alone."""
