"""The operator's screen: what a session measures, drawn in a browser while it is measured, and the buttons that act on it."""
