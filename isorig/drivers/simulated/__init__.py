"""Simulated instruments, the counterparts of the drivers. The caller provides their signals."""
