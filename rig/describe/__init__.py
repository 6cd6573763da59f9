"""A rig's description: drawn in the terminal, written from answers, and what its sensors determine."""
