"""A fleet of rigs: every recording is diagnosed once, every parameter tracked."""
