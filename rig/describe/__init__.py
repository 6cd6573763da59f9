"""A rig's description: in the terminal, as a picture, by questions, and what its sensors can tell."""
