"""A fleet of rigs: every recording diagnosed once, every parameter followed."""
